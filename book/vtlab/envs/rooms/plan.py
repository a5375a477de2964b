"""Optimal values of rooms tasks by dynamic programming on a grid, the noise integrated."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
import torch
from attrs import frozen
from scipy.sparse import csr_array, vstack
from torch import Tensor

from vtlab.envs.planning import CHUNK, GridPlan, around, sweep, try_out
from vtlab.envs.rooms.tasks import SIDE, Rooms
from vtlib.checks import check_whole
from vtlib.td import mellowmax

SPACING = 1 / 6  # between the grid's nodes, about
QUADRATURE = 9  # points per axis that stand for the noise
TOLERANCE = 1e-6  # sweeps without a number stop when no value changes by more


@frozen(eq=False)
class Grid:
    """Nodes of one rectangular grid per room, so that no interpolation reaches through a wall.

    `bottom` and `cell` (rooms,) are each room's lowest node and the height of its cells; `columns`
    nodes make a row, `rows` rows a room; `nodes` (N, 2) are ordered room by room, row by row.
    """

    task: Rooms
    bottom: Tensor
    cell: Tensor
    columns: int
    rows: int
    nodes: Tensor

    @classmethod
    def of(cls, task: Rooms) -> Grid:
        """The grid of one task."""
        edges = torch.cat([torch.zeros(1), task.walls, torch.full((1,), SIDE)])
        bottom, top = edges[:-1], edges[1:].clone()
        # A wall belongs to the room above it, and the room below ends just short of it.
        top[:-1] = torch.nextafter(top[:-1], bottom[:-1])
        columns = round(SIDE / SPACING) + 1
        rows = max(2, round(float((top - bottom).max()) / SPACING) + 1)
        ends = zip(bottom.tolist(), top.tolist(), strict=True)
        heights = torch.stack([torch.linspace(low, high, rows) for low, high in ends])
        heights = torch.minimum(heights, top[:, None]).flatten()
        nodes = torch.cartesian_prod(heights, torch.linspace(0, SIDE, columns)).flip(1)
        return cls(task, bottom, (top - bottom) / (rows - 1), columns, rows, nodes)

    def locate(self, state: Tensor) -> tuple[Tensor, Tensor]:
        """Indices (B, 4) of the nodes around states (B, 2), in their room, and their weights."""
        room = self.task.room(state)
        up = (state[:, 1] - self.bottom[room]) / self.cell[room]
        across = state[:, 0] / (SIDE / (self.columns - 1))
        cells = torch.tensor([self.rows - 1.0, self.columns - 1.0])
        (row, column), weight = around(torch.stack([up, across]), cells)
        return (row + room.unsqueeze(1) * self.rows) * self.columns + column, weight


def plan_rooms(
    tasks: Rooms, index: int, sweeps: int | None = Rooms.horizon, kappa: float | None = None
) -> GridPlan:
    """Optimal values of task `index` with `sweeps` steps to go, or endlessly with None.

    With `kappa` the values are those of the mellow Bellman operator (eq. 5.3) in place of the
    optimal ones. Raises ValueError when an argument is out of range.
    """
    copies, grid = tasks.select([index] * CHUNK), Grid.of(tasks.select([index]))
    noise = gaussian_quadrature(QUADRATURE)
    transition, reward = make_model(copies, grid, noise)

    def backup(values: Tensor) -> Tensor:
        onward = torch.from_numpy(transition @ values.numpy())
        q = (reward + Rooms.gamma * onward).view(-1, Rooms.n_actions)
        return q.amax(1) if kappa is None else mellowmax(q, kappa, 1)

    if sweeps is None:
        after = sweep(backup, len(grid.nodes), None, TOLERANCE)
    else:
        check_whole("sweeps", sweeps)
        after = sweep(backup, len(grid.nodes), sweeps - 1)
    return GridPlan(copies, grid.locate, noise, after)


def gaussian_quadrature(count: int) -> Tensor:
    """Points (count^2, 2), whose mean stands for the expectation over two standard normal numbers.

    Each axis has `count` points of equal probability, scaled to unit variance.
    """
    # Values jump at door posts and at the goal's rim. Gauss-Hermite points lie too far apart near
    # zero for that: 9 of them overrate a task by 0.001, 9 of these by 0.0002.
    quantiles = [NormalDist().inv_cdf((i + 0.5) / count) for i in range(count)]
    points = torch.tensor(quantiles, dtype=torch.float64)
    points = (points / points.square().mean().sqrt()).float()
    return torch.cartesian_prod(points, points)


def make_model(copies: Rooms, grid: Grid, noise: Tensor) -> tuple[csr_array, Tensor]:
    """The task over the grid's nodes: transition (N A, N), sparse, and expected reward (N A,).

    Averages `Rooms.step` itself over the noises (K, 2), from every node with every action, action
    fastest. Rows sum to at most one: a step that ends an episode goes nowhere.
    """
    parts, rewards = [], []
    for nodes in grid.nodes.split(CHUNK):
        reached, reward, terminated = try_out(copies, nodes, noise)
        index, weight = grid.locate(reached)
        weight = weight * ~terminated.unsqueeze(1) / len(noise)
        rewards.append(reward.view(-1, len(noise)).mean(1))
        # Many noises end among the same nodes, whose entries are summed.
        starts = np.arange(len(rewards[-1]) + 1) * (index.shape[1] * len(noise))
        entries = weight.flatten().numpy(), index.flatten().numpy(), starts
        part = csr_array(entries, shape=(len(starts) - 1, len(grid.nodes)))
        part.sum_duplicates()
        parts.append(part)
    return vstack(parts, "csr"), torch.cat(rewards)
