"""What networks believe while they learn: runs looked at on their way, and their pictures."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from vtlib.baselines import DDQNSettings
from vtlib.domains import domain
from vtlib.envs.cartpole import CartpoleFamily
from vtlib.envs.mountain_car import MountainCarFamily
from vtlib.experiments import Experiment
from vtlib.experiments.control_values import (
    NODES,
    PLANES,
    Snapshot,
    grid,
    snapshot_picture,
    snapshots,
)
from vtlib.experiments.runs import chosen_sources, targets
from vtlib.sources import NetworkPool
from vtlib.transfer import Settings

ALGORITHMS = {
    "2-MGVT": Settings(components=2, batch=5, weights=2, alpha_L=1e-4),
    "DDQN": DDQNSettings(epsilon_steps=10, batch=5, target_every=7),
}
FAMILIES = [CartpoleFamily(), MountainCarFamily()]
AT = (0, 5, 20)


def tiny(family) -> tuple[Experiment, np.ndarray]:
    pool = NetworkPool("tiny-pool", family, count=4, settings=ALGORITHMS["DDQN"])
    experiment = Experiment(
        "tiny", pool, family, ALGORITHMS, runs=3, sources=3, iterations=20, every=10
    )
    rng = np.random.default_rng(0)
    weights = 0.3 * rng.standard_normal((pool.count, domain(family).q().d))
    return experiment, weights.astype(np.float32)


@pytest.fixture(scope="module", params=FAMILIES, ids=lambda family: type(family).__name__)
def case(request):
    experiment, weights = tiny(request.param)
    taken = {label: snapshots(experiment, label, 1, weights, AT) for label in ALGORITHMS}
    return experiment, weights, taken


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: type(family).__name__)
def test_the_grid_lies_as_its_axes_do(family):
    plane, obs_dim = PLANES[type(family)], targets(tiny(family)[0], [0]).obs_dim
    states = grid(plane, obs_dim).view(NODES, NODES, obs_dim)
    across, up = plane.axes
    (left, right), (low, high) = plane.ends
    assert states[0, 0, across].item() == pytest.approx(left)
    assert states[0, -1, across].item() == pytest.approx(right)
    assert states[0, 0, up].item() == pytest.approx(low)
    assert states[-1, 0, up].item() == pytest.approx(high)
    others = [i for i in range(obs_dim) if i not in plane.axes]
    assert not states[..., others].any()


def test_values_and_actions_are_those_of_the_averaged_components(case):
    experiment, weights, taken = case
    q, run = domain(experiment.family).q(), 1
    plane = PLANES[type(experiment.family)]
    first = taken["2-MGVT"][0]
    # before learning, two components sit on the first two sources of the run
    start = torch.from_numpy(weights[chosen_sources(experiment, [run])[0, :2]]).unsqueeze(0)
    states = grid(plane, targets(experiment, [run]).obs_dim)
    values = q.q(start, q.prepare(states.unsqueeze(0)))[0].mean(0)
    np.testing.assert_allclose(first.values.ravel(), values.amax(0).numpy(), rtol=1e-5, atol=1e-5)
    assert (first.actions.ravel() == values.argmax(0).numpy()).mean() > 0.999


def test_looking_does_not_change_the_run(case):
    experiment, weights, taken = case
    for label in ALGORITHMS:
        (last,) = snapshots(experiment, label, 1, weights, (20,))
        np.testing.assert_array_equal(last.values, taken[label][-1].values)
        np.testing.assert_array_equal(last.path, taken[label][-1].path)


def test_learning_changes_the_values(case):
    *_, taken = case
    for several in taken.values():
        assert [s.iteration for s in several] == list(AT)
        assert np.abs(several[-1].values - several[0].values).max() > 1e-4


def test_the_path_begins_at_the_start_and_obeys_the_dynamics(case):
    experiment, _, taken = case
    plane, tasks = PLANES[type(experiment.family)], targets(experiment, [1])
    path = taken["DDQN"][0].path
    assert 2 <= len(path) <= tasks.horizon + 1
    np.testing.assert_allclose(path[0], np.array(plane.start)[list(plane.axes)])
    reached = []
    for action in range(tasks.n_actions):
        state, _, _ = tasks.step(
            torch.tensor([plane.start]), torch.tensor([action]), torch.zeros(1, 0)
        )
        reached.append(state[0, list(plane.axes)].numpy())
    assert min(np.abs(path[1] - there).max() for there in reached) < 1e-6


def test_a_picture_says_its_iteration_and_its_numbers(case):
    experiment, _, taken = case
    html = snapshot_picture(experiment, taken, 1)
    assert html.startswith('<img alt="Values after 5 iterations. 2-MGVT: greedy value ')
    steps = len(taken["DDQN"][1].path) - 1
    assert f"{steps} steps from the start." in html


def test_a_network_that_sees_one_action_best_everywhere_is_drawn():
    experiment, _ = tiny(MountainCarFamily())
    flat = Snapshot(
        7, np.zeros((NODES, NODES)), np.zeros((NODES, NODES), int), np.array([[-0.5, 0.0]])
    )
    assert "after 7 iterations" in snapshot_picture(experiment, {"GVT": [flat], "DDQN": [flat]}, 0)


def test_the_cartpole_plane_ends_where_the_pole_has_fallen():
    plane = PLANES[CartpoleFamily]
    assert plane.ends[0][1] / plane.units[0] == pytest.approx(12)
    assert plane.units[0] == pytest.approx(math.pi / 180)
    assert plane.axes == (2, 3)
