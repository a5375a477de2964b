"""Planned values against rollouts of the planned policy, and against each other."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from vtlib.envs import Rooms, RoomsFamily
from vtlib.envs.planning import CHUNK
from vtlib.envs.rooms import plan as planner
from vtlib.envs.rooms.plan import Grid, gaussian_quadrature, make_model, plan_rooms
from vtlib.td import mellowmax

# Of the grid (1/6) and of 81 noises, on values of 0.7 to 0.85: seen at most 0.003.
PLANNING_BIAS = 0.004
ORIGIN = torch.zeros(1, 2)


def optimum(tasks: Rooms) -> Tensor:
    return RoomsFamily().optimum(tasks)


def rollout(task: Rooms, start: Tensor, policy, seed: int) -> Tensor:
    """Discounted returns (E,) of one episode from each start (E, 2), cut at the horizon."""
    rng = np.random.default_rng(seed)
    returns = torch.zeros(len(start))
    running, state = torch.arange(len(start)), start
    for t in range(Rooms.horizon):
        noise = torch.tensor(rng.standard_normal((len(state), 2), np.float32))
        tasks = task.select([0] * len(state))
        state, reward, terminated = tasks.step(state, policy(state), noise)
        returns[running] += Rooms.gamma**t * reward
        running, state = running[~terminated], state[~terminated]
        if len(running) == 0:
            break
    return returns


def mean_and_error(returns: Tensor) -> tuple[float, float]:
    return returns.mean().item(), returns.std().item() / len(returns) ** 0.5


@pytest.mark.parametrize(
    ("doors", "sweeps"),
    [([5.0, 5.0], 50), ([2.0, 8.0], 50), ([0.5], 50), ([5.0], 50), ([6.0], None)],
)
def test_the_planned_policy_earns_the_planned_value(doors: list[float], sweeps: int | None) -> None:
    task = Rooms.from_doors([doors])
    planned = plan_rooms(task, 0, sweeps)
    mean, error = mean_and_error(rollout(task, torch.zeros(2000, 2), planned.greedy, seed=0))
    assert abs(mean - planned.value(ORIGIN).item()) < 4 * error + PLANNING_BIAS


def test_plans_know_that_the_frontier_stops() -> None:
    # along a door at the very side many steps aim beyond it
    sliding = Rooms.from_doors([[0.5, 9.5]])
    stopping = Rooms.from_doors([[0.5, 9.5]], stops=True)
    planned = plan_rooms(stopping, 0)
    mean, error = mean_and_error(rollout(stopping, torch.zeros(2000, 2), planned.greedy, seed=0))
    assert abs(mean - planned.value(ORIGIN).item()) < 4 * error + PLANNING_BIAS
    assert optimum(stopping).item() < optimum(sliding).item() - 0.02


def test_the_planned_value_holds_from_any_start() -> None:
    task = Rooms.from_doors([[3.0, 6.0]], uniform_start=True)
    planned = plan_rooms(task, 0)
    starts = torch.tensor(np.random.default_rng(1).random((2000, 2), np.float32)) * 10
    difference = rollout(task, starts, planned.greedy, seed=2) - planned.value(starts)
    mean, error = mean_and_error(difference)
    assert abs(mean) < 4 * error + PLANNING_BIAS
    assert abs(optimum(task).item() - planned.value(starts).mean().item()) < 0.01
    assert optimum(task) > optimum(Rooms.from_doors([[3.0, 6.0]]))


def by_hand(state: Tensor) -> Tensor:
    """A plain rule for a door at 5: to below the door, up through it, right, up."""
    below, aligned = state[:, 1] < 5, (state[:, 0] - 5).abs() < 0.45
    left = torch.where(state[:, 0] < 5, 1, 3)
    return torch.where(below & ~aligned, left, torch.where(state[:, 0] < 9.5, 1, 0)).where(
        ~(below & aligned), 0
    )


def test_no_other_policy_earns_more() -> None:
    task = Rooms.from_doors([[5.0]])
    mean, error = mean_and_error(rollout(task, torch.zeros(3000, 2), by_hand, seed=4))
    assert 0.5 < mean <= optimum(task).item() + 4 * error


@pytest.mark.parametrize(
    ("name", "values"), [("SPACING", (1, 1 / 2, 1 / 10)), ("QUADRATURE", (17,))]
)
def test_finer_plans_are_close(name: str, values: tuple, monkeypatch: pytest.MonkeyPatch) -> None:
    task = Rooms.from_doors([[5.0, 5.0]])
    best = plan_rooms(task, 0).value(ORIGIN).item()
    found = []
    for value in values:
        monkeypatch.setattr(planner, name, value)
        found.append(plan_rooms(task, 0).value(ORIGIN).item())
    errors = [abs(value - found[-1]) for value in (*found[:-1], best)]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.001


def test_a_door_on_the_way_is_better_than_one_off_it() -> None:
    tasks = Rooms.from_doors([[9.5, 9.5], [0.5, 0.5], [5.0, 2.0], [9.5, 0.5]])
    best = optimum(tasks)
    assert best.shape == (4,)
    assert best[0] > best[2] > best[3]
    assert best[1] > best[2]


def test_the_quadrature_has_the_moments_of_the_noise() -> None:
    points = gaussian_quadrature(9)
    assert points.shape == (81, 2)
    torch.testing.assert_close(points.mean(0), torch.zeros(2), atol=1e-6, rtol=0)
    torch.testing.assert_close(points.T @ points / 81, torch.eye(2), atol=1e-5, rtol=0)


def test_mellow_values_have_mellow_td_errors_of_mean_zero() -> None:
    # kappa so small that the mean over actions is nowhere near the maximum
    task, kappa, copies = Rooms.from_doors([[5.0]]), 3.0, 400
    planned = plan_rooms(task, 0, sweeps=None, kappa=kappa)
    g = np.random.default_rng(4)
    states = torch.from_numpy(g.random((100, 2), np.float32)) * 10
    action = torch.from_numpy(g.integers(0, Rooms.n_actions, 100))
    noise = torch.from_numpy(g.standard_normal((100 * copies, 2), np.float32))
    many = task.select([0] * 100 * copies)
    repeated = states.repeat_interleave(copies, 0), action.repeat_interleave(copies)
    reached, reward, terminated = many.step(*repeated, noise)
    after = mellowmax(planned.q(reached), kappa, -1)
    target = (reward + Rooms.gamma * ~terminated * after).view(100, copies)
    error = target - planned.q(states).gather(1, action.unsqueeze(1))
    mean, spread = mean_and_error(error.mean(1))
    assert abs(mean) < 4 * spread + PLANNING_BIAS
    loss = plan_rooms(task, 0, sweeps=None).value(states) - planned.value(states)
    assert (loss >= -1e-6).all()
    assert loss.mean() > 0.3


def test_no_value_leaks_through_a_wall() -> None:
    planned = plan_rooms(Rooms.from_doors([[9.5]]), 0)
    below, above = planned.value(torch.tensor([[1.0, 5 - 1e-3], [1.0, 5 + 1e-3]]))
    assert above - below > 0.005
    grid = Grid.of(Rooms.from_doors([[2.0, 7.0]]))
    index, weight = grid.locate(grid.nodes)
    own = (weight * (index == torch.arange(len(index)).unsqueeze(1))).sum(1)
    torch.testing.assert_close(own, torch.ones(len(own)), atol=1e-4, rtol=0)


def test_the_model_is_a_probability(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planner, "SPACING", 0.5)
    task = Rooms.from_doors([[2.0, 7.0]])
    grid = Grid.of(task)
    transition, reward = make_model(task.select([0] * CHUNK), grid, gaussian_quadrature(9))
    mass = torch.from_numpy(transition @ np.ones(len(grid.nodes), np.float32))
    torch.testing.assert_close(mass + reward, torch.ones_like(mass))
    assert (transition.data >= 0).all()
    # Interpolation keeps a linear function, so where nothing blocks the mean moves by the step.
    inner = ((grid.nodes - torch.tensor([5.0, 1.7])).abs() < 0.3).all(1).nonzero()[:, 0]
    assert len(inner) > 0
    after = torch.from_numpy(transition @ grid.nodes[:, 0].numpy()).view(-1, 4)
    mean_x = after[inner] - grid.nodes[inner, :1]
    moved = torch.tensor([1.0, -1.0]).expand(len(inner), 2)
    torch.testing.assert_close(mean_x[:, [1, 3]], moved, atol=1e-4, rtol=0)


def test_bad_arguments() -> None:
    task = Rooms.from_doors([[5.0]])
    for arguments, message in (
        ((0, 0), "sweeps must be a whole number from 1"),
        ((0, 2, 0.0), "kappa must be positive"),
    ):
        with pytest.raises(ValueError, match=message):
            plan_rooms(task, *arguments)
