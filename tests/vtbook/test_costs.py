"""What sources cost, by hand, where runs solve their task, do so at last, or never."""

import numpy as np
import pytest
from xarray import Dataset

from vtbook.costs import cost, steps_to_solve
from vtlab.stats import mean_interval

POOL = Dataset(
    # the second kept what it had after 300, and was trained to its limit twice
    {"iterations": ("source", [1_000, 300]), "solved": ("source", [True, False])},
    attrs={"config": {"limit": 1_500, "attempts": 2}},
)
FLOOR = -90.0  # from which nine tenths of the way to the optimum of -40 lie at -45


def runs(*reached, level=-45.0):
    """Runs that earn a level from such an iteration on, infinity for never, the floor before."""
    times = np.array([100, 200, 300])
    learning = np.where(times >= np.array(reached)[:, None], level, FLOOR)
    data = {"learning": (("run", "iteration"), learning)}
    return Dataset(data | {"optimum": ("run", [-40.0] * len(reached))}, {"iteration": times})


def test_a_task_is_solved_the_first_time_at_nine_tenths_of_the_way_from_the_floor():
    some = runs(100, 300, 200, np.inf)
    some.learning[2, 2] = FLOOR  # lost again
    for one in (some, some.transpose("iteration", "run")):
        np.testing.assert_array_equal(steps_to_solve(one, FLOOR), [100, 300, 200, np.nan])
    assert np.isnan(steps_to_solve(runs(100, level=-45.1), FLOOR)).all()
    # from a floor of 0 they lie at -36
    found = [steps_to_solve(runs(100, level=level))[0] for level in (-36.0, -36.1)]
    np.testing.assert_array_equal(found, [100, np.nan])


def test_runs_that_never_solve_count_with_all_their_steps():
    pair = runs(100, 100, 200, np.inf), runs(300, np.inf, 200, np.inf)
    found = cost(POOL, 10, *pair, FLOOR)
    assert found.sources == 20_000  # ten of 2,000 steps
    np.testing.assert_array_equal(found.with_transfer, [100, 100, 200, 300])
    np.testing.assert_array_equal(found.without, [300, 300, 200, 300])
    assert (found.unsolved, found.unsolved_without) == (1, 2)
    # paired: 200, 200, 0 and 0
    assert found.saved == mean_interval(np.array([200.0, 200, 0, 0]))
    assert found.tasks == pytest.approx(200)
    # what saves nothing never pays
    for one in pair:
        assert cost(POOL, 1, one, pair[0], FLOOR).tasks == np.inf
