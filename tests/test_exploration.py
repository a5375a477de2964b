"""Where agents go: runs looked at on their way, and the pictures of what they believe."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import torch

from vtlib.domains import rooms_q
from vtlib.envs.rooms import RoomsFamily
from vtlib.experiments import Experiment, exploration
from vtlib.experiments.exploration import (
    NODES,
    SAMPLES,
    Snapshot,
    density_figure,
    snapshot_picture,
    snapshots,
)
from vtlib.experiments.runs import chosen_sources, run_batch
from vtlib.sources import Pool
from vtlib.streams import generator
from vtlib.transfer import Settings, initial_posterior

Q = rooms_q()
POOL = Pool("tiny-pool", RoomsFamily(rooms=2), count=6)
WEIGHTS = np.random.default_rng(0).random((POOL.count, Q.d), dtype=np.float32)
TINY = Experiment(
    "tiny",
    POOL,
    RoomsFamily(rooms=2, fixed_lower=5.0),
    {
        "GVT": Settings("gaussian", batch=5, weights=2),
        "1-MGVT": Settings(batch=5, weights=2),
        "2-MGVT": Settings(components=2, batch=5, weights=2),
    },
    runs=3,
    sources=4,
    iterations=20,
    every=10,
    visits=True,
)


@pytest.fixture(scope="module")
def taken() -> dict[str, list[Snapshot]]:
    return {label: snapshots(TINY, label, 1, WEIGHTS, (0, 5, 20)) for label in ("GVT", "1-MGVT")}


def same(one: Snapshot, other: Snapshot) -> bool:
    arrays = ("path", "mean", "deviation")
    return one.iteration == other.iteration and all(
        np.array_equal(getattr(one, key), getattr(other, key)) for key in arrays
    )


def value_at(weights: torch.Tensor, x: float, y: float) -> torch.Tensor:
    """max_a Q (S,) of weights (S, d) at one position."""
    prepared = Q.prepare(torch.tensor([[[x, y]]]))
    return Q.q(weights.unsqueeze(0), prepared)[0, :, :, 0].amax(1)


@pytest.mark.parametrize("label", TINY.algorithms)
def test_before_the_first_step_it_is_the_initial_posterior(label):
    run = 2
    (first,) = snapshots(TINY, label, run, WEIGHTS, [0])
    assert first.iteration == 0
    assert first.path.shape == (0, 2)
    assert first.mean.shape == first.deviation.shape == (NODES, NODES)
    sources = torch.from_numpy(WEIGHTS[chosen_sources(TINY, [run])])
    start, _ = initial_posterior(sources, TINY.algorithms[label])
    noise = generator(TINY.stream, run, "snapshots").standard_normal((SAMPLES, Q.d), np.float32)
    # sample by sample: the first half from the first of two components, the rest from the second
    components = start.mu.shape[1]
    drawn = [
        start.mu[0, s * components // SAMPLES]
        + start.L[0, s * components // SAMPLES] @ torch.from_numpy(z)
        for s, z in enumerate(noise)
    ]
    # rows count upwards and columns to the right, a quarter of a unit each
    for row, column in ((0, 0), (0, 40), (40, 0), (40, 40), (7, 22), (22, 7)):
        values = value_at(torch.stack(drawn), column / 4, row / 4).numpy()
        np.testing.assert_allclose(first.mean[row, column], values.mean(), rtol=1e-4)
        deviation = values.std(ddof=1)
        np.testing.assert_allclose(first.deviation[row, column], deviation, rtol=1e-3)


@pytest.mark.parametrize(("axis", "far"), [(0, (0, -1)), (1, (-1, 0))], ids=["across", "up"])
def test_the_grid_lies_as_the_square_does(axis, far):
    # sources whose value is the distance from the left side, or from the bottom
    centres = torch.cartesian_prod(torch.arange(11.0), torch.arange(11.0))
    weights = (centres[:, axis] / 10).repeat(POOL.count, 4).numpy()
    # hardly any spread around the mean
    sharp = replace(TINY, algorithms={"1-MGVT": Settings(sigma_p2=1e-12, batch=5, weights=2)})
    (first,) = snapshots(sharp, "1-MGVT", 0, weights, [0])
    assert first.mean[0, 0] == pytest.approx(0.0, abs=0.02)
    assert first.mean[far] == pytest.approx(1.0, abs=0.02)
    assert first.mean[far[::-1]] == pytest.approx(0.0, abs=0.02)
    assert first.mean[-1, -1] == pytest.approx(1.0, abs=0.02)
    assert (first.deviation < 1e-4).all()
    along = first.mean if axis == 0 else first.mean.T
    np.testing.assert_allclose(along, np.broadcast_to(along[0], along.shape), atol=1e-4)
    assert (np.diff(along, axis=1) > -1e-4).all()


def test_a_mixture_is_looked_at_in_every_component():
    # two components at sources whose values differ everywhere: zero and one
    weights = np.repeat(np.arange(POOL.count, dtype=np.float32)[:, None] % 2, Q.d, 1)
    run = next(r for r in range(50) if chosen_sources(TINY, [r])[0, :2].sum() % 2)
    (first,) = snapshots(TINY, "2-MGVT", run, weights, [0])
    # half of the samples each; the maximum over four actions adds about a standard deviation
    assert first.mean == pytest.approx(0.5, abs=0.01)
    expected = 0.5 * np.sqrt(SAMPLES / (SAMPLES - 1))
    assert first.deviation == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("label", ["GVT", "1-MGVT"])
def test_the_same_iterations_look_the_same_twice(taken, label):
    again = snapshots(TINY, label, 1, WEIGHTS, (0, 5, 20))
    assert len(again) == 3
    assert all(map(same, again, taken[label]))


@pytest.mark.parametrize("label", ["GVT", "1-MGVT"])
def test_looking_does_not_change_the_run(taken, label):
    (last,) = snapshots(TINY, label, 1, WEIGHTS, [20])
    assert same(last, taken[label][-1])


@pytest.mark.parametrize("label", ["GVT", "1-MGVT"])
def test_the_path_grows(taken, label):
    first, second, last = taken[label]
    assert [one.iteration for one in taken[label]] == [0, 5, 20]
    assert (len(first.path), len(second.path), len(last.path)) == (0, 5, 20)
    np.testing.assert_array_equal(second.path, last.path[:5])
    assert len(np.unique(last.path, axis=0)) > 5
    # it learns on the way
    assert not np.array_equal(first.mean, second.mean)
    assert not np.array_equal(second.deviation, last.deviation)


@pytest.mark.parametrize("label", ["GVT", "1-MGVT"])
def test_the_path_is_the_one_that_the_experiment_stores(taken, label):
    stored = run_batch(TINY, label, [1], WEIGHTS)["visited"][0]
    np.testing.assert_array_equal(taken[label][-1].path, stored)


def test_another_run_goes_another_way(taken):
    (other,) = snapshots(TINY, "GVT", 0, WEIGHTS, [5])
    assert not same(other, taken["GVT"][1])


def alt_of(html: str) -> str:
    return re.search(r'alt="([^"]*)"', html).group(1)


@pytest.mark.parametrize(("index", "iteration"), [(0, 0), (2, 20)])
def test_a_picture_says_its_iteration_and_its_numbers(taken, index, iteration):
    html = snapshot_picture(TINY, taken, index)
    assert html.startswith("<img")
    alt = alt_of(html)
    assert alt.startswith(f"Posterior after {iteration} iterations.")
    for label in ("GVT", "1-MGVT"):
        shown = taken[label][index]
        assert (
            f"{label}: value at the start {shown.mean[0, 0]:.2f}, "
            f"largest deviation {shown.deviation.max():.3f}"
        ) in alt


def test_the_density_counts_every_visit_in_its_cell(monkeypatch):
    # one run of two stays in the cell from (2, 0), the other moves to the cell from (7, 4)
    visited = np.full((2, 8, 2), (2.5, 0.5), dtype=np.float32)
    visited[1, 4:] = 7.5, 4.5
    monkeypatch.setattr(exploration, "visited", lambda name, label: visited)
    figure = density_figure(TINY, ["NT", "GVT"])
    for ax in figure.axes[:2]:
        # rows count upwards, columns to the right
        share = np.ma.filled(ax.images[0].get_array(), 0.0)
        share = np.nan_to_num(share)
        assert share.shape == (10, 10)
        assert (share[0, 2], share[4, 7]) == (0.75, 0.25)
        assert share.sum() == pytest.approx(1)
        assert ax.images[0].origin == "lower"
    assert [ax.get_title("left") for ax in figure.axes[:2]] == ["ε-greedy", "GVT"]
    assert len(density_figure(TINY, ["GVT"]).axes) == 2  # and the colour bar
