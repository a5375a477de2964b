"""What all tasks and their families have in common, and tasks given by a few positive numbers."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from vtlib import envs
from vtlib.envs.base import TaskFamily

FAMILIES = {
    "rooms": envs.RoomsFamily(),
    "two rooms": envs.RoomsFamily(2, normal=(5.0, 1.8)),
    "cartpole": envs.CartpoleFamily(),
    "mountain car": envs.MountainCarFamily(),
    "maze": envs.MazeFamily(),
}
every_family = pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES)


# --- tasks ------------------------------------------------------------------------------------


@every_family
def test_a_row_does_not_feel_its_neighbours_and_no_argument_changes(family: TaskFamily) -> None:
    count = 99
    rng = np.random.default_rng(0)
    tasks = family.sample(rng, count)
    u = torch.tensor(rng.random((count, tasks.start_dim), np.float32))
    state = tasks.start(u)
    for _ in range(11):
        action = torch.tensor(rng.integers(tasks.n_actions, size=count))
        noise = torch.tensor(rng.standard_normal((count, tasks.noise_dim), np.float32))
        arguments = state, action, noise
        before = [x.clone() for x in arguments]
        state, _, _ = tasks.step(state, action, noise)

    def outcome(rows: slice, some) -> tuple[Tensor, ...]:
        state, action, noise = (x[rows] for x in arguments)
        return *some.step(state, action, noise), some.observe(state), some.start(u[rows])

    together = outcome(slice(None), tasks)
    assert all(map(torch.equal, before, arguments))
    real, shape = torch.float32, tuple(state.shape)
    assert [(x.dtype, tuple(x.shape)) for x in together] == [
        (real, shape),
        (real, shape[:1]),
        (torch.bool, shape[:1]),
        (real, (count, tasks.obs_dim)),
        (real, shape),
    ]
    for row in range(count):
        rows = slice(row, row + 1)
        for batched, single in zip(together, outcome(rows, tasks.select([row])), strict=True):
            assert torch.equal(batched[rows], single)
    for wrong in range(3):
        shapes = [torch.cat([x, x]) if i == wrong else x for i, x in enumerate(arguments)]
        with pytest.raises(ValueError, match="state, action, noise must have shapes"):
            tasks.step(*shapes)


@every_family
def test_select_takes_and_repeats_tasks_and_join_appends_them(family: TaskFamily) -> None:
    tasks = family.sample(np.random.default_rng(1), 3)
    for index in ([2, 0, 0], np.array([-1, 0, 0]), torch.tensor([2, 0, -3])):
        chosen = tasks.select(index)
        assert type(chosen) is type(tasks)
        joined = family.values(family.join([tasks.select([1]), chosen]))
        for name, rows in family.values(tasks).items():
            np.testing.assert_array_equal(getattr(chosen, name), rows[[2, 0, 0]])
            np.testing.assert_array_equal(joined[name], rows[[1, 2, 0, 0]])
    for bad in ([3], [-4], [0.5], [True]):
        with pytest.raises(IndexError):
            tasks.select(bad)
    with pytest.raises(ValueError, match="at least one batch"):
        family.join([])
    with pytest.raises(ValueError, match=r"count must be a whole number from 1 .*, got 0"):
        family.sample(np.random.default_rng(0), 0)


def test_numbers_and_vectors_of_one_number_per_task_make_a_batch() -> None:
    tasks = envs.Cartpole.of(3, cart_mass=1.0, pole_mass=[0.1, 0.2, 0.3], half_length=np.ones(3))
    assert len(tasks) == 3
    assert tasks.cart_mass.tolist() == [1.0] * 3
    assert torch.equal(tasks.pole_mass, torch.tensor([0.1, 0.2, 0.3]))
    for speed in ([0.001], [0.001] * 3, [[0.001] * 2]):
        with pytest.raises(ValueError, match=r"speed must be a number or have shape \(2,\), got"):
            envs.MountainCar.of(2, speed=speed)


VECTORS = "parameters must be float32 vectors of one length, got"


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        *(
            (torch.tensor([1.0, value]), f"pole_mass must be positive and finite, got {value:g}")
            for value in (0.0, -1.0, float("nan"), float("inf"))
        ),
        *((x, VECTORS) for x in (torch.ones(3), torch.ones(2, 1), torch.tensor(1.0))),
        (torch.ones(2).double(), VECTORS),
    ],
)
def test_parameters_are_positive_finite_vectors_of_one_length(wrong: Tensor, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        envs.Cartpole(torch.ones(2), wrong, torch.ones(2))


# --- families ---------------------------------------------------------------------------------


@every_family
def test_a_run_has_its_task_whatever_the_other_runs_are(family: TaskFamily) -> None:
    together, alone = family.draw_tasks("a", range(9)), family.draw_tasks("a", [5])
    others = family.values(family.draw_tasks("b", range(9)))
    for name, rows in family.values(together).items():
        np.testing.assert_array_equal(rows[5:6], getattr(alone, name))
        assert not np.array_equal(others[name], rows)
        assert len(np.unique(rows, axis=0)) > 1


@pytest.mark.parametrize(
    ("family", "ranges"),
    [
        (envs.RoomsFamily(), [(0.5, 9.5)] * 2),
        (envs.CartpoleFamily(), [(0.5, 1.5), (0.1, 0.3), (0.2, 1.0)]),
        (envs.MountainCarFamily(), [(0.001, 0.0015)]),
    ],
)
def test_a_family_draws_uniform_and_independent_parameters(family, ranges) -> None:
    values = family.values(family.sample(np.random.default_rng(3), 4000)).values()
    low, high = np.array(ranges, np.float32).T
    share = (np.column_stack(list(values)) - low) / (high - low)
    assert 0 <= share.min() < 0.01
    assert 0.99 < share.max() <= 1.0001
    # Four standard errors of the mean of a uniform number.
    assert np.abs(share.mean(0) - 0.5).max() < 0.02
    assert np.abs(np.atleast_2d(np.corrcoef(share.T)) - np.eye(len(ranges))).max() < 0.07


@pytest.mark.parametrize(
    ("name", "d"), [("rooms", 484), ("cartpole", 226), ("mountain car", 387), ("maze", 1891)]
)
def test_first_weights_are_a_runs_own_and_zero_for_linear_values(name: str, d: int) -> None:
    family = FAMILIES[name]
    weights = family.first_weights("t", range(40))
    assert weights.shape == (40, family.q().d) == (40, d)
    assert torch.equal(family.first_weights("t", [5])[0], weights[5])
    assert weights.std().item() == pytest.approx(family.scale, rel=0.04)
    assert family.scale == (0.0 if name == "rooms" else 0.1)


def test_within_ten_percent_also_holds_for_negative_returns() -> None:
    returns = torch.tensor([[-54.0, -56.0], [-56.0, -56.0], [-20.0, -20.0]])
    solved = envs.MountainCarFamily().solved
    assert solved(returns, torch.full((3,), -50.0), 0.9).tolist() == [True, False, True]
    assert solved(torch.tensor([[0.75, 0.71]]), torch.tensor([0.8]), 0.9).tolist() == [True]
