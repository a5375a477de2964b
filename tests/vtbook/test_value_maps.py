"""Value maps: the grid, what is mapped over it, and on the way of a run."""

import numpy as np
import pytest
import torch

from vtbook.experiments.mountain_car import CAR_COURSE
from vtbook.value_maps import NODES, on_the_way, plane_states, value_map
from vtlab.envs import CartpoleFamily, MountainCarFamily
from vtlab.run import chosen_sources
from vtlab.store import results_folder
from vtlab.store import weights as weights_of


def task_of(family):
    return family.sample(np.random.default_rng(0), 1)


def mapped(family):
    """The map of two made-up components, and their weights."""
    mu = 0.3 * np.random.default_rng(1).standard_normal((1, 2, family.q().d), dtype=np.float32)
    weights = torch.from_numpy(mu).requires_grad_()
    return value_map(family, task_of(family), weights), weights.detach()


@pytest.mark.parametrize("kind", [CartpoleFamily, MountainCarFamily])
def test_a_map_holds_the_mean_values_over_its_plane_and_the_greedy_policy_s_path(kind):
    family = kind()
    (one, mu), plane, task, q = mapped(family), family.plane, task_of(family), family.q()
    grid = np.zeros((NODES, NODES, task.obs_dim))
    ends = (np.linspace(*each, NODES) for each in plane.ends)
    grid[..., list(plane.axes)] = np.stack(np.meshgrid(*ends), -1)
    states = plane_states(plane, task.obs_dim)
    np.testing.assert_allclose(states.view(grid.shape), grid, atol=1e-6)
    expected = sum(q.q(mu[:, [c]], q.prepare(states[None]))[0, 0] for c in (0, 1)) / 2
    np.testing.assert_allclose(one.values, expected.view(one.values.shape), rtol=1e-5, atol=1e-6)
    assert 2 <= len(one.path) <= task.horizon + 1
    state = torch.tensor([plane.start])
    for place in one.path:
        np.testing.assert_array_equal(state[0, list(plane.axes)].numpy(), place)
        action = q.q(mu, q.prepare(state[None]))[0].mean(0).argmax(0)
        state, _, _ = task.step(state, action, torch.zeros(1, 0))


def test_what_is_learned_on_the_way_is_what_the_probe_stored():
    pool = weights_of(CAR_COURSE.pool)
    (start, size), (mean, later) = on_the_way(CAR_COURSE, "1-MGVT", pool, (0, 5_000))
    chosen = pool[chosen_sources(CAR_COURSE, [0])[0]]
    np.testing.assert_allclose(start[0, 0], chosen.mean(0), rtol=1e-3, atol=1e-4)
    stored = np.load(results_folder() / CAR_COURSE.name / "1-MGVT.npz")
    index = list(stored["iterations"]).index(5_000)
    np.testing.assert_array_equal(mean, stored["mean"][:, index])
    assert later == pytest.approx(float(stored["size"][0, index]))
    assert 0 < size < 1
