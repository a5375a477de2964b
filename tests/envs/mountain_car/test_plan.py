"""Planned values of the mountain car against the dynamics themselves."""

from __future__ import annotations

import pytest
import torch
from attrs import evolve
from torch import Tensor

from vtlib.envs import MountainCar, MountainCarFamily
from vtlib.envs.mountain_car import plan as planner
from vtlib.envs.mountain_car.plan import plan_mountain_car

TASKS = MountainCar(torch.tensor([0.001, 0.0015]))
STARTS = torch.stack([torch.linspace(-0.85, -0.05, 9), torch.zeros(9)], 1)


@pytest.fixture(scope="module")
def plans():
    return [plan_mountain_car(TASKS, index) for index in range(2)]


def follow(index: int, choose) -> Tensor:
    """Discounted returns (9,) of a policy from the starts, cut only after 400 steps."""
    tasks = TASKS.select(torch.full((len(STARTS),), index))
    state, alive, total = STARTS, torch.ones(len(STARTS)), torch.zeros(len(STARTS))
    for t in range(400):
        state, reward, terminated = tasks.step(state, choose(state), torch.zeros(len(STARTS), 0))
        total += 0.99**t * reward * alive
        alive = alive * ~terminated
    return total


@pytest.mark.parametrize("index", [0, 1])
def test_planned_values_are_what_the_planned_policy_earns(plans, index):
    earned = follow(index, plans[index].greedy)
    excess = plans[index].q(STARTS).amax(1) - earned
    # half a step is worth 0.3; the grid blurs more where two ways to the top are equally long
    assert excess.abs().median() < 0.3
    assert (excess.abs() < 2).all()


@pytest.mark.parametrize("index", [0, 1])
def test_the_planned_policy_beats_pushing_along_with_the_motion(plans, index):
    planned = follow(index, plans[index].greedy)
    along = follow(index, lambda state: torch.where(state[:, 1] >= 0, 2, 0))
    assert (planned >= along - 0.05).all()
    assert planned.mean() > along.mean() + 0.5


def test_the_step_that_arrives_costs_nothing(plans):
    states = torch.tensor([[0.49, 0.07], [0.49, -0.07]])
    q = plans[0].q(states)
    torch.testing.assert_close(q[0], torch.zeros(3))
    assert (q[1] < -1).all()


def test_a_last_step_that_costs_is_discounted_from_where_it_is_taken(monkeypatch):
    monkeypatch.setattr(planner, "CELLS", (120, 90))
    costly = evolve(TASKS, last_reward=-1.0)
    free, paid = (MountainCarFamily().optimum(tasks) for tasks in (TASKS, costly))
    # an episode of T steps at -1 each but the last earns g = -(1 - 0.99^(T - 1)) / 0.01: the T-th
    # costs 0.99^(T - 1) = 1 + g / 100 more; T differs between starts, and the mean is linear
    torch.testing.assert_close(free - paid, 1 + 0.01 * free, rtol=0, atol=0.02)


def test_a_stronger_motor_earns_more(monkeypatch):
    monkeypatch.setattr(planner, "CELLS", (120, 90))
    slow, fast = MountainCarFamily().optimum(TASKS).tolist()
    assert fast > slow + 5
    assert -60 < slow < -50
