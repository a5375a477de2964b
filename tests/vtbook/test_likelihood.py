"""Returns by the likelihood of the task: bins by hand, and the published figure beside them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from attrs import evolve
from xarray import Dataset

from vtbook import likelihood
from vtbook.experiments import rooms
from vtlib.experiments.run import targets
from vtlib.stats import mean_interval

DOORS = np.array([[5.0], [5.0], [3.2], [6.8], [2.0], [8.0], [8.6], [1.4], [0.5], [9.5]])
# one deviation of 1.8 from 5 there are exp(-1/2) of the density, and so on
BINS = [4, 4, 3, 3, 1, 1, 0, 0, 0, 0]


@pytest.fixture
def stored(monkeypatch):
    """Runs at these doors: 1-MGVT earns half of its optimum, GVT the square of that share."""
    optimum = np.linspace(0.5, 1.0, len(DOORS))
    tasks = Dataset({"doors": (("run", "doors_1"), DOORS), "optimum": ("run", optimum)})

    def returns(experiment: object, label: str) -> Dataset:
        wave = 1 + 0.1 * np.resize([1.0, -1.0], len(DOORS))
        share = {"1-MGVT": 0.5, "GVT": 0.25}[label] * wave
        learning = np.stack([share * optimum * (1 + t / 4_000) for t in likelihood.AT], 1)
        data = {"learning": (("run", "iteration"), learning), "optimum": ("run", optimum)}
        return Dataset(data, {"iteration": list(likelihood.AT)})

    monkeypatch.setattr(likelihood, "load", lambda *_: tasks)
    monkeypatch.setattr(likelihood, "returns", returns)
    return optimum


def test_a_likelihood_is_the_density_over_its_largest(stored):
    found = likelihood.likelihoods(rooms.ROOMS_LIKELIHOOD.published)
    by_hand = [math.exp(-0.5 * ((door - 5.0) / 1.8) ** 2) for (door,) in DOORS]
    np.testing.assert_allclose(found, by_hand)
    assert found[2] == pytest.approx(math.exp(-0.5))


def test_a_bin_holds_its_upper_edge(monkeypatch):
    for value, place in ((0.001, 0), (0.2, 0), (0.2001, 1), (0.4, 1), (0.8001, 4), (1.0, 4)):
        monkeypatch.setattr(likelihood, "likelihoods", lambda _, value=value: np.array([value]))
        assert likelihood.bin_of(rooms.ROOMS_LIKELIHOOD.published) == [place]


def test_bins_hold_each_runs_share_of_its_own_optimum(stored):
    place = likelihood.bin_of(rooms.ROOMS_LIKELIHOOD.published)
    np.testing.assert_array_equal(place, BINS)


def test_both_protocols_and_the_published_figure_have_five_bins(stored, monkeypatch):
    # the made-up doors leave a bin empty
    monkeypatch.setattr(likelihood, "bin_of", lambda _: np.repeat(np.arange(5), 2))
    found = likelihood.binned()
    assert set(found) == {"published", "equations", "printed"}
    assert {len(bins) for one in found.values() for bins in one.values()} == {5}
    for name in ("published", "equations"):
        assert found[name]["GVT", 1_000][0] == pytest.approx(
            mean_interval(0.25 * 1.25 * np.array([1.1, 0.9]))
        )
    table = likelihood.rows("rooms-likelihood")
    row = table[(table["algorithm"] == "1-MGVT") & (table["iteration"] == 4_000)][3]
    best = stored[6:8].mean()  # of the runs in the fourth bin
    expected = [row[x] / best for x in ("mean", "low", "high")]
    assert found["printed"]["1-MGVT", 4_000][3] == pytest.approx(expected)


def test_published_rows_go_from_the_unlikeliest_to_the_likeliest_task():
    table = likelihood.rows("rooms-likelihood")
    for label in likelihood.LABELS:
        for t in likelihood.AT:
            rows = table[(table["algorithm"] == label) & (table["iteration"] == t)]
            np.testing.assert_allclose(rows["normalised_likelihood"], likelihood.EDGES)


def test_every_bin_has_runs_of_the_published_doors():
    experiment = evolve(rooms.ROOMS_LIKELIHOOD.published, runs_per_task=20)
    doors = targets(experiment, range(experiment.runs)).doors[:, 0]
    assert sorted(set(doors.tolist())) == [x / 2 for x in range(1, 20)]
    values = np.exp(-0.5 * ((doors.numpy() - 5.0) / 1.8) ** 2)
    counts = np.bincount(np.searchsorted(likelihood.EDGES, values - 1e-6), minlength=5)
    assert (counts >= 40).all()
