"""What sources cost, by hand, where runs solve their task, do so at last, or never."""

from __future__ import annotations

import numpy as np
import pytest
from xarray import Dataset

from vtbook.costs import cost, steps_to_solve
from vtlib.stats import mean_interval

POOL = Dataset({"iterations": ("source", [1_000, 3_000])})


def runs(*reached: float, optimum: float = 10.0, level: float = 9.0, floor: float = 0.0) -> Dataset:
    """Runs that earn a level from such an iteration on, infinity for never, and a floor before."""
    times = np.array([100, 200, 300])
    learning = np.where(times >= np.array(reached)[:, None], level, floor)
    best = ("run", np.full(len(reached), optimum))
    data = {"learning": (("run", "iteration"), learning), "optimum": best}
    return Dataset(data, {"iteration": times})


def test_a_task_is_solved_the_first_time_at_nine_tenths_of_the_way_from_the_floor():
    some = runs(100, 300, 200, np.inf)
    some.learning[2, 2] = 0.0  # lost again
    for one in (some, some.transpose("iteration", "run")):
        np.testing.assert_array_equal(steps_to_solve(one), [100, 300, 200, np.nan])
    assert np.isnan(steps_to_solve(runs(100, level=8.999))).all()
    # from a floor of -90 to an optimum of -40 nine tenths lie at -45
    for level, steps in ((-45.0, 200.0), (-45.1, np.nan)):
        car = runs(200, optimum=-40.0, level=level, floor=-90.0)
        np.testing.assert_array_equal(steps_to_solve(car, floor=-90.0), [steps])


def test_runs_that_never_solve_count_with_all_their_steps():
    found = cost(POOL, 10, runs(100, 100, 200, np.inf), runs(300, np.inf, 200, np.inf))
    assert found.sources == 20_000  # ten of 2,000 steps
    np.testing.assert_array_equal(found.with_transfer, [100, 100, 200, 300])
    np.testing.assert_array_equal(found.without, [300, 300, 200, 300])
    assert (found.unsolved, found.unsolved_without) == (1, 2)
    # paired: 200, 200, 0 and 0
    assert found.saved == mean_interval(np.array([200.0, 200, 0, 0]))
    assert found.tasks == pytest.approx(200)


def test_what_saves_nothing_never_pays():
    for without in (100, 200):
        assert cost(POOL, 1, runs(200, 200), runs(without, without)).tasks == np.inf


def test_the_floor_holds_for_both():
    car = runs(100, 300, optimum=-40.0, level=-45.0, floor=-90.0)
    for floor, unsolved in ((-90.0, 0), (0.0, 2)):
        found = cost(POOL, 1, car, car, floor)
        assert (found.unsolved, found.unsolved_without) == (unsolved, unsolved)
