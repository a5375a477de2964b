"""Value maps: the grid, what is mapped over it, and how it is drawn."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from attrs import evolve
from matplotlib.figure import Figure

from vtbook.value_maps import NODES, ValueMap, draw_map, maps_picture, plane_states, value_map
from vtlib.envs import CartpoleFamily, MountainCarFamily, RoomsFamily

FAMILIES = [CartpoleFamily(), MountainCarFamily()]
every_family = pytest.mark.parametrize("family", FAMILIES, ids=lambda one: type(one).__name__)


def task_of(family):
    return family.sample(np.random.default_rng(0), 1)


def mapped(family, components: int = 2) -> tuple[ValueMap, torch.Tensor]:
    mu = 0.3 * np.random.default_rng(1).standard_normal((1, components, family.q().d))
    weights = torch.from_numpy(mu).float().requires_grad_()
    return value_map(family, task_of(family), weights), weights.detach()


@every_family
def test_the_grid_lies_as_its_axes_do(family):
    plane, dimensions = family.plane, task_of(family).obs_dim
    states = plane_states(plane, dimensions).view(NODES, NODES, dimensions)
    across, up = plane.axes
    (left, right), (low, high) = plane.ends
    assert states[0, 0, across].item() == pytest.approx(left)
    assert states[0, -1, across].item() == pytest.approx(right)
    assert states[0, 0, up].item() == pytest.approx(low)
    assert states[-1, 0, up].item() == pytest.approx(high)
    others = [i for i in range(dimensions) if i not in plane.axes]
    assert not states[..., others].any()


@every_family
def test_values_are_those_of_the_averaged_components(family):
    one, mu = mapped(family)
    row, column = 17, 43
    state = plane_states(family.plane, task_of(family).obs_dim)[row * NODES + column]
    q = family.q()
    expected = [q.q(mu[:, [c]], q.prepare(state[None, None]))[0, 0, :, 0] for c in (0, 1)]
    expected = torch.stack(expected).mean(0).numpy()
    np.testing.assert_allclose(one.values[:, row, column], expected, rtol=1e-5, atol=1e-6)


@every_family
def test_the_path_is_the_greedy_policy_s(family):
    one, mu = mapped(family)
    plane, task, q = family.plane, task_of(family), family.q()
    assert 2 <= len(one.path) <= task.horizon + 1
    state = torch.tensor([plane.start])
    for place in one.path:
        np.testing.assert_array_equal(state[0, list(plane.axes)].numpy(), place)
        action = q.q(mu, q.prepare(state[None]))[0].mean(0).argmax(0)
        state, _, _ = task.step(state, action, torch.zeros(1, 0))


def test_a_family_without_a_plane_has_no_map():
    family = RoomsFamily()
    with pytest.raises(ValueError, match="RoomsFamily has no plane"):
        value_map(family, task_of(family), torch.zeros(1, 1, family.q().d))


def test_a_map_is_drawn_in_the_units_of_its_labels():
    one, _ = mapped(CartpoleFamily())
    ax = Figure().subplots()
    image = draw_map(ax, one)
    assert ax.get_xlim() == pytest.approx((-12, 12))
    assert (ax.get_xlabel(), ax.get_ylabel()) == CartpoleFamily.plane.labels
    np.testing.assert_array_equal(image.get_array(), one.values.max(0))
    assert image.get_clim() == CartpoleFamily.plane.values
    (path,) = ax.get_lines()
    np.testing.assert_allclose(path.get_xdata(), one.path[:, 0] * 180 / math.pi, rtol=1e-6)


def test_a_picture_says_its_iteration_and_its_numbers():
    one, _ = mapped(MountainCarFamily())
    # a network that sees the same action best everywhere has no borders
    flat = evolve(one, values=np.full((3, NODES, NODES), -7.0))
    html = maps_picture({"1-MGVT": one, "DDQN": flat}, 1500)
    assert html.startswith('<img alt="Values after 1500 iterations. 1-MGVT: greedy value ')
    assert f"DDQN: greedy value -7 to -7, {len(one.path) - 1} steps from the start." in html
