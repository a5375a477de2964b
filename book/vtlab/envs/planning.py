"""What the planners share: nodes around a state, every action tried out, values for any state."""

from collections.abc import Callable
from itertools import count
from typing import Any

import torch
from attrs import frozen
from torch import Tensor

# Indices and weights (B, 2^n) of the nodes around states (B, n).
Locate = Callable[[Tensor], tuple[Tensor, Tensor]]
CHUNK = 1024  # states that step together, few enough for the processor's cache


def around(place: Tensor, cells: Tensor) -> tuple[Tensor, Tensor]:
    """The 2^n nodes (n, B, 2^n) int64 around places (n, B) on a grid, with weights (B, 2^n).

    Places count cells from the first node; those outside the grid of `cells` (n,) are moved onto
    it. The weights are multilinear; nodes of the last axis vary fastest.
    """
    cells = cells.unsqueeze(1)
    place = torch.minimum(place.clamp(min=0), cells)
    first = torch.minimum(place.floor(), cells - 1)
    share = place - first
    weight, *axes = torch.stack([1 - share, share], -1)  # (B, 2) each
    for side in axes:
        weight = (weight.unsqueeze(2) * side.unsqueeze(1)).flatten(1)
    corner = torch.cartesian_prod(*[torch.arange(2)] * len(place)).T
    return first.long().unsqueeze(2) + corner.unsqueeze(1), weight


def try_out(copies: Any, states: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Every action from each of B states under each of K noises (K, noise_dim), noise fastest.

    `copies` is one task as often as steps are taken at once. Returns states (B A K, n), rewards
    and terminated (B A K,).
    """
    points, chunk = len(noise), len(copies)
    every = states.repeat_interleave(points * copies.n_actions, 0).split(chunk)
    actions = torch.arange(copies.n_actions).repeat_interleave(points).repeat(len(states))
    noises = noise.repeat(len(states) * copies.n_actions, 1).split(chunk)
    parts = []
    for state, action, z in zip(every, actions.split(chunk), noises, strict=True):
        tasks = copies if len(state) == chunk else copies.select(torch.arange(len(state)))
        parts.append(tasks.step(state, action, z))
    reached, reward, terminated = (torch.cat(part) for part in zip(*parts, strict=True))
    return reached, reward, terminated


@frozen(eq=False)
class GridPlan:
    """Optimal values of one task for any state: one step of the dynamics, then the grid's values.

    `copies` is the task many times, `locate` gives indices and weights (B, 2^n) of the nodes around
    states (B, n), `noise` (K, noise_dim) stands for all noise; `values` (nodes,) hold after a step.
    """

    copies: Any
    locate: Locate
    noise: Tensor
    values: Tensor

    def q(self, states: Tensor) -> Tensor:
        """Optimal action values (B, A) at the states (B, n)."""
        # Interpolating the nodes' action values would mix, beside a door post, nodes before the
        # door with nodes before the wall, and 1 to 2 % of the episodes would get stuck.
        parts = []
        for part in states.split(CHUNK):
            reached, reward, terminated = try_out(self.copies, part, self.noise)
            index, weight = self.locate(reached)
            after = (self.values[index] * weight).sum(-1) * ~terminated
            q = (reward + self.copies.gamma * after).view(len(part), self.copies.n_actions, -1)
            parts.append(q.mean(-1))
        return torch.cat(parts)

    def value(self, states: Tensor) -> Tensor:
        """Optimal discounted return (B,) from the states (B, n)."""
        return self.q(states).amax(1)

    def greedy(self, states: Tensor) -> Tensor:
        """Optimal actions (B,) int64 at the states (B, n)."""
        return self.q(states).argmax(1)


def sweep(
    backup: Callable[[Tensor], Tensor], nodes: int, sweeps: int | None, tolerance: float = 0.0
) -> Tensor:
    """Values (nodes,) after backups from zero: so many, or until none changes by more."""
    values = torch.zeros(nodes)
    for _ in count() if sweeps is None else range(sweeps):
        before, values = values, backup(values)
        if float((values - before).abs().max()) <= tolerance:
            break
    return values


def plan_without_noise(
    tasks: Any,
    index: int,
    nodes: Tensor,
    locate: Locate,
    sweeps: int | None,
    tolerance: float = 0.0,
) -> GridPlan:
    """The plan of one task of a batch, as if it had no noise, over the nodes (N, n) of a grid.

    Raises IndexError when there is no such row.
    """
    copies, still = tasks.select([index] * CHUNK), torch.zeros(1, tasks.noise_dim)
    reached, reward, terminated = try_out(copies, nodes, still)
    at, weight = locate(reached)
    weight = weight * (copies.gamma * ~terminated).unsqueeze(-1)

    def backup(values: Tensor) -> Tensor:
        q = reward + (values[at] * weight).sum(-1)
        return torch.amax(q.view(len(nodes), -1), 1)

    return GridPlan(copies, locate, still, sweep(backup, len(nodes), sweeps, tolerance))
