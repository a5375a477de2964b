"""Optimal values of mountain car tasks by dynamic programming on a fine grid."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from vtlib.envs.mountain_car import MountainCar

CELLS = (240, 180)  # of the grid, in position and in velocity
LOW, HIGH = (-1.2, -0.07), (0.5, 0.07)
STARTS = 200  # evenly spread over the positions where episodes begin


@dataclass(frozen=True, eq=False)
class CarPlan:
    """Optimal values (nodes,) of one task, without a limit on the steps."""

    task: MountainCar
    values: Tensor

    def q(self, states: Tensor) -> Tensor:
        """Optimal action values (B, 3) at states (B, 2): one step made, then the grid's values."""
        count, actions = len(states), MountainCar.n_actions
        reached, reward, terminal = _step_all(self.task, states)
        index, weight = _locate(reached)
        after = (self.values[index] * weight).sum(-1) * ~terminal
        return (reward + MountainCar.gamma * after).view(count, actions)


def plan_mountain_car(tasks: MountainCar, index: int, tolerance: float = 1e-3) -> CarPlan:
    """Optimal values of one task by value iteration; the dynamics have no noise."""
    task = tasks.select(torch.tensor([index]))
    nodes = _nodes()
    reached, reward, terminal = _step_all(task, nodes)
    at, weight = _locate(reached)
    weight = weight * (MountainCar.gamma * ~terminal).unsqueeze(-1)
    values = torch.zeros(len(nodes))
    while True:
        better = (reward + (values[at] * weight).sum(-1)).view(-1, MountainCar.n_actions).amax(1)
        change = float((better - values).abs().max())
        values = better
        if change <= tolerance:
            return CarPlan(task, values)


def car_optimum(tasks: MountainCar) -> Tensor:
    """What the planned policy earns (R,): its discounted return over the episodes' own starts.

    The plan's policy is followed in the dynamics themselves, so the number is one that a policy
    reaches, whatever the grid's error.
    """
    return torch.stack([_earned(tasks, index) for index in range(len(tasks))])


def _earned(tasks: MountainCar, index: int) -> Tensor:
    plan = plan_mountain_car(tasks, index)
    copies = tasks.select(torch.full((STARTS,), index))
    state = copies.start(((torch.arange(STARTS) + 0.5) / STARTS).unsqueeze(1))
    alive, total, discount = torch.ones(STARTS), torch.zeros(STARTS), 1.0
    none = torch.zeros(STARTS, 0)
    for _ in range(MountainCar.horizon):
        state, reward, terminal = copies.step(state, plan.q(state).argmax(1), none)
        total.add_(reward * alive, alpha=discount)
        alive *= ~terminal
        discount *= MountainCar.gamma
    return total.mean()


def _nodes() -> Tensor:
    axes = [
        torch.linspace(low, high, cells + 1)
        for low, high, cells in zip(LOW, HIGH, CELLS, strict=True)
    ]
    return torch.cartesian_prod(*axes)


def _step_all(task: MountainCar, states: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Every action from each state: states (B * 3, 2) reached, reward, terminal, action fastest."""
    count, actions = len(states), MountainCar.n_actions
    tasks = task.select(torch.zeros(count * actions, dtype=torch.int64))
    action = torch.arange(actions).repeat(count)
    noise = torch.zeros(count * actions, 0)
    return tasks.step(states.repeat_interleave(actions, 0), action, noise)


def _locate(states: Tensor) -> tuple[Tensor, Tensor]:
    """The four nodes around states (B, 2), and their bilinear weights, both (B, 4)."""
    low, high, cells = (torch.tensor(x, dtype=torch.float32) for x in (LOW, HIGH, CELLS))
    place = ((states - low) / (high - low)).clamp(0, 1) * cells
    corner = torch.minimum(place.floor(), cells - 1)
    (across, up), (x, v) = (place - corner).unbind(1), corner.long().unbind(1)
    rows = CELLS[1] + 1
    first = x * rows + v
    index = torch.stack([first, first + 1, first + rows, first + rows + 1], 1)
    weight = torch.stack(
        [(1 - across) * (1 - up), (1 - across) * up, across * (1 - up), across * up], 1
    )
    return index, weight
