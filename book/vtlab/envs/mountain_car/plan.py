"""Optimal values of mountain car tasks by dynamic programming on a fine grid."""

import torch
from torch import Tensor

from vtlab.envs.mountain_car.tasks import GOAL, MAX_SPEED, POSITIONS, MountainCar
from vtlab.envs.planning import GridPlan, around, plan_without_noise

CELLS = (240, 180)  # of the grid, in position and in velocity
LOW, HIGH = (POSITIONS[0], -MAX_SPEED), (GOAL, MAX_SPEED)
TOLERANCE = 1e-3
STARTS = 200  # evenly spread over the positions where episodes begin


def plan_mountain_car(tasks: MountainCar, index: int) -> GridPlan:
    """Optimal values of one task, without a limit on the steps. Raises IndexError for no row."""
    axes = [torch.linspace(*ends) for ends in zip(LOW, HIGH, [n + 1 for n in CELLS], strict=True)]
    nodes = torch.cartesian_prod(*axes)
    return plan_without_noise(tasks, index, nodes, _locate, None, TOLERANCE)


def mean_return(tasks: MountainCar, index: int) -> Tensor:
    """The mean discounted return () of the planned policy over the episodes' own starts.

    It is followed in the dynamics, so a policy reaches this number, whatever the grid's error.
    """
    planned, copies = plan_mountain_car(tasks, index), tasks.select([index] * STARTS)
    state = copies.start(((torch.arange(STARTS) + 0.5) / STARTS).unsqueeze(1))
    alive, total, discount = torch.ones(STARTS), torch.zeros(STARTS), 1.0
    none = torch.zeros(STARTS, 0)
    for _ in range(MountainCar.horizon):
        state, reward, terminated = copies.step(state, planned.greedy(state), none)
        total.add_(reward * alive, alpha=discount)
        alive *= ~terminated
        discount *= MountainCar.gamma
    return total.mean()


def _locate(states: Tensor) -> tuple[Tensor, Tensor]:
    """Indices (B, 4) of the nodes around states (B, 2), and their weights."""
    low, high, cells = (torch.tensor(x, dtype=torch.float32) for x in (LOW, HIGH, CELLS))
    (x, v), weight = around(((states - low) / (high - low) * cells).T, cells)
    return x * (CELLS[1] + 1) + v, weight
