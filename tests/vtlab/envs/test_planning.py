"""Planned values against rollouts of the planned policy, and what can be known without a plan."""

from unittest.mock import Mock

import numpy as np
import pytest
import torch
from attrs import evolve

from vtlab.envs import MazeFamily, Mazes, MountainCar, MountainCarFamily, Rooms, RoomsFamily, maze
from vtlab.envs.maze import plan as maze_planner
from vtlab.envs.maze.plan import mean_return, plan_maze
from vtlab.envs.mountain_car import plan as car_planner
from vtlab.envs.mountain_car.plan import plan_mountain_car
from vtlab.envs.rooms import plan as rooms_planner
from vtlab.envs.rooms.plan import plan_rooms
from vtlib.td import mellowmax

# Of the grid (1/6) and of 36 noises, on values of 0.7 to 0.85: seen at most 0.0033.
PLANNING_BIAS = 0.004
DOOR = Rooms.from_doors([[5.0]])
CARS = MountainCar.of(2, speed=[0.001, 0.0015])
OPEN = Mazes(torch.zeros(1, 10, 10, dtype=torch.bool), torch.tensor([[9, 9]]))
TWO = Mazes.of(["south-west 12", "north-east 4"])
MAZES = Mazes(torch.cat([OPEN.walls, TWO.walls]), torch.cat([OPEN.goal, TWO.goal]))


def rollout(tasks, index, state, policy, steps, noise=0.0):
    """Discounted returns (E,) of one episode from each state (E, n), under noise of that scale."""
    rng, total = np.random.default_rng(0), torch.zeros(len(state))
    running = torch.arange(len(state))
    for t in range(steps):
        z = torch.from_numpy(rng.standard_normal((len(state), tasks.noise_dim), np.float32))
        copies = tasks.select([index] * len(state))
        state, reward, terminated = copies.step(state, policy(state), noise * z)
        total[running] += tasks.gamma**t * reward
        running, state = running[~terminated], state[~terminated]
        if not len(running):
            break
    return total


def off_zero(errors):
    """By how much the mean of some errors is more than four of its standard errors."""
    return errors.mean().abs().item() - 4 * errors.std().item() / len(errors) ** 0.5


@pytest.mark.parametrize(
    ("doors", "options"),
    [
        ([2.0, 8.0], {}),
        ([3.0, 6.0], {"uniform_start": True}),
        # along a door at the very side many steps aim beyond it
        ([0.5, 9.5], {"stops": True}),
    ],
)
def test_the_planned_policy_earns_the_planned_value(doors, options, monkeypatch):
    monkeypatch.setattr(rooms_planner, "QUADRATURE", 6)
    task = Rooms.from_doors([doors], **options)
    planned = plan_rooms(task, 0)
    start = task.start(torch.rand(2000, 2, generator=torch.Generator().manual_seed(1)))
    values = planned.value(start)
    returns = rollout(task, 0, start, planned.greedy, Rooms.horizon, noise=1.0)
    assert off_zero(returns - values) < PLANNING_BIAS
    assert abs(RoomsFamily().optimum(task).item() - values.mean().item()) < 0.01


# kappa so small that the mean over actions is nowhere near the maximum
@pytest.mark.parametrize("kappa", [None, 3.0])
def test_values_have_td_errors_of_mean_zero(kappa):
    planned, copies = plan_rooms(DOOR, 0, sweeps=None, kappa=kappa), 100
    g = torch.Generator().manual_seed(4)
    states, noise = 10 * torch.rand(100, 2, generator=g), torch.randn(100 * copies, 2, generator=g)
    action = torch.randint(Rooms.n_actions, (100,), generator=g)
    repeated = states.repeat_interleave(copies, 0), action.repeat_interleave(copies)
    reached, reward, terminated = DOOR.select([0] * 100 * copies).step(*repeated, noise)
    q = planned.q(reached)
    after = q.amax(1) if kappa is None else mellowmax(q, kappa, -1)
    target = (reward + Rooms.gamma * ~terminated * after).view(100, copies)
    error = target - planned.q(states).gather(1, action.unsqueeze(1))
    assert off_zero(error.mean(1)) < PLANNING_BIAS / 10  # it adds up over an episode


def test_a_door_on_the_way_is_better_and_no_value_leaks_through_a_wall(monkeypatch):
    monkeypatch.setattr(rooms_planner, "SPACING", 1 / 3)
    tasks = Rooms.from_doors([[5.0, 2.0], [9.5, 9.5], [0.5, 0.5], [9.5, 0.5]])
    between, right, left, worst = RoomsFamily().optimum(tasks)
    assert min(right, left) > between > worst
    ends = torch.tensor([[1.0, 5 - 1e-3], [1.0, 5 + 1e-3]])
    below, above = plan_rooms(Rooms.from_doors([[9.5]]), 0).value(ends)
    assert above - below > 0.005


@pytest.mark.parametrize("index", [0, 1])
def test_a_planned_car_earns_its_values_and_beats_pushing_along(index):
    starts = torch.stack([torch.linspace(-0.85, -0.05, 9), torch.zeros(9)], 1)
    plan = plan_mountain_car(CARS, index)
    returns = rollout(CARS, index, starts, plan.greedy, 400)
    excess = plan.value(starts) - returns
    # half a step is worth 0.3; the grid blurs more where two ways to the top are equally long
    assert excess.abs().median() < 0.3
    assert (excess.abs() < 2).all()
    along = rollout(CARS, index, starts, lambda state: torch.where(state[:, 1] >= 0, 2, 0), 400)
    assert (returns >= along - 0.05).all()
    assert returns.mean() > along.mean() + 0.5
    arrives, leaves = plan.q(torch.tensor([[0.49, 0.07], [0.49, -0.07]]))
    torch.testing.assert_close(arrives, torch.zeros(3))
    assert (leaves < -1).all()


def test_a_stronger_motor_earns_more_and_a_last_step_that_costs_is_discounted(monkeypatch):
    monkeypatch.setattr(car_planner, "CELLS", (120, 90))
    costly = evolve(CARS, last_reward=-1.0)
    free, paid = (MountainCarFamily().optimum(tasks) for tasks in (CARS, costly))
    assert free[1] > free[0] + 5
    assert -60 < free[0] < -50
    # an episode of T steps at -1 each but the last earns g = -(1 - 0.99^(T - 1)) / 0.01: the T-th
    # costs 0.99^(T - 1) = 1 + g / 100 more; T differs between starts, and the mean is linear
    torch.testing.assert_close(free - paid, 1 + 0.01 * free, rtol=0, atol=0.02)


@pytest.fixture(scope="module")
def plans():
    return [plan_maze(MAZES, index) for index in range(3)]


def starts(index, count):
    u = torch.rand(count, 4, generator=torch.Generator().manual_seed(0))
    return MAZES.select([index] * count).start(u)


@pytest.mark.parametrize("index", [0, 1, 2])
def test_planned_values_are_what_the_policy_earns_without_noise(plans, index):
    start, plan = starts(index, 300), plans[index]
    excess = plan.value(start) - rollout(MAZES, index, start, plan.greedy, Mazes.horizon)
    # A step too many is worth 0.01; far away 100 steps may just not do, or just do.
    assert excess.abs().median() < 0.015
    assert excess.mean().abs() < 0.03


def test_a_goal_is_worth_the_steps_to_it_and_nothing_through_a_wall(plans):
    x = 8.75 - 0.5 * torch.arange(8)
    q = plans[0].q(torch.stack([x, torch.full((8,), 9.5), torch.zeros(8)], 1))
    assert (q.argmax(1) == 0).all()
    torch.testing.assert_close(q[:, 0], 0.99 ** torch.arange(8.0), atol=0.01, rtol=0)
    assert q[0].tolist() == pytest.approx([1.0, 0.99, 0.99], abs=0.003)
    # Either side of the first wall below the goal of "north-east 4".
    above, below = plans[2].value(torch.tensor([[8.5, 9.1, 0.0], [8.5, 5.9, 0.0]]))
    assert above > 0.98
    assert below < 0.7


def test_the_optimum_of_a_maze_is_its_own(plans, monkeypatch):
    monkeypatch.setattr(maze_planner, "EPISODES", 400)
    planned = Mock(side_effect=lambda _, index: plans[2 - 2 * index])
    monkeypatch.setattr(maze, "plan_maze", planned)
    optimum = MazeFamily().optimum(MAZES.select([2, 0, 2, 2]))
    assert sorted(call.args[1] for call in planned.call_args_list) == [0, 1]
    easy, hard = mean_return(plans[0]), mean_return(plans[2])
    assert torch.equal(optimum, torch.stack([hard, easy, hard, hard]))
    assert easy > hard
