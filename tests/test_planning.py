"""Planned values against rollouts of the planned policy, and against each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from vtlib.envs.rooms import Rooms
from vtlib.mellow import mellowmax
from vtlib.planning import Plan, gaussian_quadrature, make_grid, make_model, optimal_return, plan

# Of the grid (1/6) and of 81 noises, on values of 0.7 to 0.85: seen at most 0.003.
PLANNING_BIAS = 0.004
ORIGIN = torch.zeros(1, 2)

Policy = Callable[[Tensor, int], Tensor]


def rollout(task: Rooms, start: Tensor, policy: Policy, seed: int) -> Tensor:
    """Discounted returns (E,) of one episode from each start (E, 2), cut at the horizon."""
    rng = np.random.default_rng(seed)
    returns = torch.zeros(len(start))
    running, state = torch.arange(len(start)), start
    for t in range(Rooms.horizon):
        noise = torch.tensor(rng.standard_normal((len(state), 2), np.float32))
        tasks = task.select([0] * len(state))
        state, reward, terminal = tasks.step(state, policy(state, Rooms.horizon - t), noise)
        returns[running] += Rooms.gamma**t * reward
        running, state = running[~terminal], state[~terminal]
        if len(running) == 0:
            break
    return returns


def mean_and_error(returns: Tensor) -> tuple[float, float]:
    return returns.mean().item(), returns.std().item() / len(returns) ** 0.5


@pytest.mark.parametrize("doors", [[5.0, 5.0], [9.5, 0.5], [2.0, 8.0], [0.5], [5.0]])
def test_the_planned_policy_earns_the_planned_value(doors: list[float]) -> None:
    task = Rooms.from_doors([doors])
    planned = plan(task, 0)
    returns = rollout(task, torch.zeros(2000, 2), planned.greedy, seed=0)
    mean, error = mean_and_error(returns)
    assert abs(mean - planned.value(ORIGIN).item()) < 4 * error + PLANNING_BIAS


def test_the_planned_value_holds_from_any_start() -> None:
    task = Rooms.from_doors([[3.0, 6.0]], uniform_start=True)
    planned = plan(task, 0)
    starts = torch.tensor(np.random.default_rng(1).random((2000, 2), np.float32)) * 10
    difference = rollout(task, starts, planned.greedy, seed=2) - planned.value(starts)
    mean, error = mean_and_error(difference)
    assert abs(mean) < 4 * error + PLANNING_BIAS
    assert abs(optimal_return(task).item() - planned.value(starts).mean().item()) < 0.01


def test_the_endless_plan_acts_well_too() -> None:
    task = Rooms.from_doors([[6.0]])
    planned = plan(task, 0, sweeps=None)
    returns = rollout(task, torch.zeros(2000, 2), lambda s, _: planned.greedy(s), seed=3)
    mean, error = mean_and_error(returns)
    assert abs(mean - planned.value(ORIGIN).item()) < 4 * error + PLANNING_BIAS


def up_and_right(state: Tensor, steps: int) -> Tensor:
    """A plain rule for a door at 5: to below the door, up through it, right, up."""
    below, aligned = state[:, 1] < 5, (state[:, 0] - 5).abs() < 0.45
    left = torch.where(state[:, 0] < 5, 1, 3)
    return torch.where(below & ~aligned, left, torch.where(state[:, 0] < 9.5, 1, 0)).where(
        ~(below & aligned), 0
    )


def at_random(state: Tensor, steps: int) -> Tensor:
    return torch.tensor(np.random.default_rng(steps).integers(4, size=len(state)))


@pytest.mark.parametrize("policy", [up_and_right, at_random])
def test_no_other_policy_earns_more(policy: Policy) -> None:
    task = Rooms.from_doors([[5.0]])
    mean, error = mean_and_error(rollout(task, torch.zeros(3000, 2), policy, seed=4))
    assert mean <= optimal_return(task).item() + 4 * error
    if policy is up_and_right:
        assert mean > 0.5


def test_finer_grids_converge() -> None:
    task = Rooms.from_doors([[5.0, 5.0]])
    values = [
        plan(task, 0, spacing=spacing).value(ORIGIN).item() for spacing in (1, 1 / 2, 1 / 6, 1 / 10)
    ]
    errors = [abs(value - values[-1]) for value in values[:-1]]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 0.001


def test_more_noises_change_nothing() -> None:
    task = Rooms.from_doors([[5.0, 5.0]])
    coarse, fine = (
        plan(task, 0, spacing=1 / 4, quadrature=count).value(ORIGIN).item() for count in (9, 17)
    )
    assert abs(coarse - fine) < 0.001


def test_a_door_on_the_way_is_better_than_one_off_it() -> None:
    tasks = Rooms.from_doors([[9.5, 9.5], [0.5, 0.5], [5.0, 2.0], [9.5, 0.5]])
    best = optimal_return(tasks)
    assert best.shape == (4,)
    assert best[0] > best[2] > best[3]
    assert best[1] > best[2]


def test_the_values_of_the_last_room_do_not_depend_on_the_doors() -> None:
    states = torch.tensor([[1.0, 8.5], [5.0, 9.5], [8.0, 8.0]])
    near, far = (
        plan(Rooms.from_doors([doors]), 0).value(states) for doors in ([1.0, 5.0], [9.0, 6.0])
    )
    torch.testing.assert_close(near, far, atol=1e-4, rtol=0)


def test_time_is_worth_something() -> None:
    planned = plan(Rooms.from_doors([[9.5]]), 0)
    values = [planned.value(ORIGIN, steps).item() for steps in (5, 10, 17, 20, 50)]
    assert values[0] == values[1] == 0.0
    assert 0 < values[2] < values[3] < values[4]


def test_close_to_the_goal_values_are_those_of_one_step() -> None:
    planned = plan(Rooms.from_doors([[5.0]]), 0)
    beside = torch.tensor([[8.5, 9.9]])
    # RIGHT misses the goal, and another way meets it, only by a noise of 2.5 deviations.
    assert planned.greedy(beside).item() == 1
    assert planned.q(beside)[0, 1].item() == pytest.approx(1.0, abs=0.01)
    # The other three ways lose one step.
    assert planned.q(beside)[0, [0, 3]].max().item() <= 0.99 + 1e-5


def test_no_value_leaks_through_a_wall() -> None:
    planned = plan(Rooms.from_doors([[9.5]]), 0)
    wall = planned.grid.task.walls[0].item()
    below, above = planned.value(torch.tensor([[1.0, wall - 1e-3], [1.0, wall + 1e-3]]))
    assert above - below > 0.005
    nodes = torch.arange(len(planned.grid.nodes)).float()
    on_nodes = planned.grid.interpolate(nodes, planned.grid.nodes)
    torch.testing.assert_close(on_nodes, nodes, atol=0.05, rtol=0)


def test_the_model_is_a_probability() -> None:
    grid = make_grid(Rooms.from_doors([[2.0, 7.0]]), spacing=0.5)
    model = make_model(grid, gaussian_quadrature(9))
    mass = model.transition @ torch.ones(len(grid.nodes))
    torch.testing.assert_close(mass + model.reward, torch.ones_like(mass))
    assert bool((model.transition.values() > 0).all())
    # Interpolation keeps a linear function, so where nothing blocks the mean moves by the step.
    inner = ((grid.nodes - torch.tensor([5.0, 1.7])).abs() < 0.3).all(1).nonzero()[:, 0]
    assert len(inner) > 0
    mean_x = (model.transition @ grid.nodes[:, 0]).view(4, -1)[:, inner] - grid.nodes[inner, 0]
    torch.testing.assert_close(
        mean_x[[1, 3]], torch.tensor([[1.0], [-1.0]]).expand(2, len(inner)), atol=1e-4, rtol=0
    )


def test_the_quadrature_has_the_moments_of_the_noise() -> None:
    points = gaussian_quadrature(9)
    assert points.shape == (81, 2)
    torch.testing.assert_close(points.mean(0), torch.zeros(2), atol=1e-6, rtol=0)
    torch.testing.assert_close(points.T @ points / 81, torch.eye(2), atol=1e-5, rtol=0)


def test_tasks_of_a_batch_are_planned_one_by_one() -> None:
    tasks = Rooms.from_doors([[2.0], [8.0]])
    together = optimal_return(tasks)
    alone = torch.cat([optimal_return(tasks.select([row])) for row in range(2)])
    assert torch.equal(together, alone)


def test_mellow_values_have_mellow_td_errors_of_mean_zero() -> None:
    # kappa so small that the mean over actions is nowhere near the maximum
    task, kappa, copies = Rooms.from_doors([[5.0]]), 3.0, 400
    planned = plan(task, 0, sweeps=None, kappa=kappa)
    g = np.random.default_rng(4)
    states = torch.from_numpy(g.random((100, 2), np.float32)) * 10
    action = torch.from_numpy(g.integers(0, Rooms.n_actions, 100))
    noise = torch.from_numpy(g.standard_normal((100 * copies, 2), np.float32))
    many = task.select([0] * 100 * copies)
    repeated = states.repeat_interleave(copies, 0), action.repeat_interleave(copies)
    reached, reward, terminal = many.step(*repeated, noise)
    after = mellowmax(planned.q(reached), kappa, -1)
    target = (reward + Rooms.gamma * ~terminal * after).view(100, copies)
    error = target - planned.q(states).gather(1, action.unsqueeze(1))
    mean, spread = mean_and_error(error.mean(1))
    assert abs(mean) < 4 * spread + PLANNING_BIAS
    loss = plan(task, 0, sweeps=None).value(states) - planned.value(states)
    assert (loss >= -1e-6).all()
    assert loss.mean() > 0.3


def test_a_sharp_mellowmax_plans_the_optimal_values() -> None:
    task = Rooms.from_doors([[5.0]])
    states = torch.from_numpy(np.random.default_rng(5).random((50, 2), np.float32)) * 10
    sharp = plan(task, 0, None, spacing=0.5, kappa=1e5).q(states)
    torch.testing.assert_close(sharp, plan(task, 0, None, spacing=0.5).q(states), rtol=0, atol=3e-3)


def test_starting_anywhere_is_better_than_starting_in_the_far_corner() -> None:
    task = Rooms.from_doors([[5.0]])
    assert optimal_return(replace(task, uniform_start=True)) > optimal_return(task)


@pytest.fixture(scope="module")
def small() -> Plan:
    return plan(Rooms.from_doors([[5.0]]), 0, sweeps=3, spacing=1.0, quadrature=2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"index": 1}, r"index must lie in 0..0, got 1"),
        ({"index": -1}, r"index must lie in 0..0, got -1"),
        ({"sweeps": 0}, "sweeps must be at least 1, or None, got 0"),
        ({"spacing": 0.0}, "spacing must lie in"),
        ({"spacing": float("nan")}, "spacing must lie in"),
        ({"quadrature": 1}, r"quadrature must lie in 2..50, got 1"),
        ({"tolerance": 0.0}, "tolerance must be at least"),
        ({"kappa": 0.0}, "kappa must be positive"),
    ],
)
def test_bad_arguments(arguments: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        plan(Rooms.from_doors([[5.0]]), **{"index": 0, **arguments})  # type: ignore[arg-type]


def test_bad_queries(small: Plan) -> None:
    for steps in (0, 4):
        with pytest.raises(ValueError, match=rf"steps_to_go must lie in 1..3, got {steps}"):
            small.value(ORIGIN, steps)
    with pytest.raises(ValueError, match=r"states must have shape \(B, 2\), got \(2,\)"):
        small.q(torch.zeros(2))
    for value in (-0.1, 10.1, float("nan")):
        with pytest.raises(ValueError, match=r"states must lie in \[0, 10\]"):
            small.q(torch.full((1, 2), value))
