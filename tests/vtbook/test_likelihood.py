"""Returns by the likelihood of the task: bins by hand, and the published figure beside them.

The unit is a door: its runs are averaged, and intervals are over doors.
"""

import numpy as np
import pytest
from xarray import Dataset

from vtbook import likelihood
from vtbook.experiments import rooms
from vtlab.stats import mean_interval

HERE = rooms.ROOMS_LIKELIHOOD
EACH = HERE.runs_per_task
# Two doors in each of five bins, which hold their upper edges.
LIKELIHOODS = np.array([0.001, 0.2, 0.2001, 0.4, 0.41, 0.5, 0.61, 0.8, 0.8001, 1.0])
DOORS = 5 + 1.8 * np.resize([1, -1], 10) * np.sqrt(-2 * np.log(LIKELIHOODS))
OPTIMUM = np.linspace(0.5, 1.0, 10)


@pytest.fixture
def stored(monkeypatch):
    """Runs at these doors: 1-MGVT earns half of its optimum, GVT the square of that share."""
    doors, optimum = DOORS.repeat(EACH), OPTIMUM.repeat(EACH)
    tasks = Dataset({"doors": (("run", "doors_1"), doors[:, None]), "optimum": ("run", optimum)})
    luck = np.resize([0.5, 1.5], EACH * len(DOORS))  # of the runs at a door

    def returns(_, label):
        share = {"1-MGVT": 0.5, "GVT": 0.25}[label] * np.resize([1.1, 0.9], 10).repeat(EACH)
        learning = np.outer(luck * share * optimum, 1 + np.array(likelihood.AT) / 4_000)
        return tasks.assign(learning=(("run", "iteration"), learning), iteration=[*likelihood.AT])

    monkeypatch.setattr(likelihood, "load", lambda *_: tasks)
    monkeypatch.setattr(likelihood, "returns", returns)


def test_bins_hold_shares_of_each_runs_optimum_and_the_published_ones_of_theirs(stored):
    np.testing.assert_allclose(likelihood.likelihoods(HERE), LIKELIHOODS.repeat(EACH))
    # up to the upper edge
    np.testing.assert_array_equal(likelihood.bin_of(HERE), np.arange(5).repeat(2 * EACH))
    expected = mean_interval(0.25 * 1.25 * np.array([1.1, 0.9]))
    np.testing.assert_allclose(likelihood.binned(HERE)["GVT", 1_000], [expected] * 5)
    table = likelihood.rows("rooms-likelihood")
    for (label, t), bins in likelihood.printed(HERE).items():
        rows = table[(table["algorithm"] == label) & (table["iteration"] == t)]
        np.testing.assert_allclose(rows["normalised_likelihood"], likelihood.EDGES)
        expected = np.stack([rows[x] for x in ("mean", "low", "high")], 1)
        np.testing.assert_allclose(bins, expected / OPTIMUM.reshape(5, 2).mean(1, keepdims=True))
