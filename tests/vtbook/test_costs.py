"""What sources cost, by hand, where runs solve their task, do so at last, or never."""

from __future__ import annotations

import numpy as np
import pytest
from xarray import Dataset

from vtbook.costs import cost, steps_to_solve
from vtlib.stats import mean_interval

POOL = Dataset({"iterations": ("source", [1_000, 3_000])})


def runs(*reached: float, optimum: float = 10.0, level: float = 9.0) -> Dataset:
    """Runs that earn a level from such an iteration on, infinity for never, and nothing before."""
    times = np.array([100, 200, 300])
    learning = np.where(times >= np.array(reached)[:, None], level, 0.0)
    data = {"learning": (("run", "iteration"), learning)}
    best = {"optimum": ("run", np.full(len(reached), optimum))}
    return Dataset({**data, **best}, {"iteration": times})


def test_a_task_is_solved_at_nine_tenths_of_the_way_from_the_floor():
    np.testing.assert_array_equal(steps_to_solve(runs(100, 300, np.inf)), [100, 300, np.nan])
    assert np.isnan(steps_to_solve(runs(100, level=8.999))).all()
    # from a floor of -90 to an optimum of -40 nine tenths lie at -45
    for level, steps in ((-45.0, 200.0), (-45.1, np.nan)):
        car = runs(200, optimum=-40.0, level=level)
        car["learning"] = car.learning.where(car.learning != 0, -90.0)
        np.testing.assert_array_equal(steps_to_solve(car, floor=-90.0), [steps])


def test_solving_is_dated_by_the_first_time_although_it_is_lost_again():
    lost = runs(200)
    lost.learning[0, 2] = 0.0
    assert steps_to_solve(lost) == [200]


def test_axes_may_come_in_any_order():
    turned = runs(100, 300).transpose("iteration", "run")
    np.testing.assert_array_equal(steps_to_solve(turned), [100, 300])


def test_runs_that_never_solve_count_with_all_their_steps():
    found = cost(POOL, 10, runs(100, 100, 200, np.inf), runs(300, np.inf, 200, np.inf))
    assert found.sources == 20_000  # ten of 2,000 steps
    np.testing.assert_array_equal(found.with_transfer, [100, 100, 200, 300])
    np.testing.assert_array_equal(found.without, [300, 300, 200, 300])
    assert (found.unsolved, found.unsolved_without) == (1, 2)
    # paired: 200, 200, 0 and 0
    assert found.saved == mean_interval(np.array([200.0, 200, 0, 0]))
    assert found.tasks == pytest.approx(200)


@pytest.mark.parametrize("without", [(100, 100), (100, 200)])
def test_what_saves_nothing_never_pays(without):
    assert cost(POOL, 1, runs(200, 200), runs(*without)).tasks == np.inf


def test_the_floor_holds_for_both():
    car = [runs(100, 300, optimum=-40.0, level=-45.0) for _ in range(2)]
    for one in car:
        one["learning"] = one.learning.where(one.learning != 0, -90.0)
    found = cost(POOL, 1, *car, floor=-90.0)
    assert (found.unsolved, found.unsolved_without) == (0, 0)
    assert cost(POOL, 1, *car).unsolved == 2
