"""Value maps: the grid, what is mapped over it, and on the way of a run."""

from itertools import pairwise

import numpy as np
import pytest
import torch

from vtbook import value_maps
from vtbook.value_maps import (
    NODES,
    on_the_way,
    plane_states,
    value_map,
)
from vtlab.envs import CartpoleFamily, MountainCarFamily


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


@pytest.mark.parametrize("label", ["DDQN", "GVT"])
def test_what_is_learned_on_the_way_is_kept_and_the_same_without_kernels(
    tiny, weights, label, monkeypatch
):
    at = (0, 30, 60)
    by_kernels = [*on_the_way(tiny, label, weights[:3], at)]
    monkeypatch.setattr(value_maps, "prepare_natively", lambda *_: None)
    by_torch = [*on_the_way(tiny, label, weights[:3], at)]
    means = [mu for mu, _ in by_torch]
    assert all((a != b).any() for a, b in pairwise(means))
    for (mu, size), (same, other) in zip(by_kernels, by_torch, strict=True):
        np.testing.assert_allclose(mu, same, rtol=1e-3, atol=1e-4)
        assert size == pytest.approx(other, rel=1e-3)
        assert (size > 0) == (label == "GVT")
