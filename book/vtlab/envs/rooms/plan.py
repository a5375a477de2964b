"""Optimal values of rooms tasks by dynamic programming on a grid, the noise integrated."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
import torch
from scipy.sparse import csr_array, vstack
from torch import Tensor

from vtlab.envs.planning import CHUNK, GridPlan, Locate, around, sweep, try_out
from vtlab.envs.rooms.tasks import SIDE, Rooms
from vtlib.td import mellowmax

SPACING = 1 / 6  # between the grid's nodes, about
QUADRATURE = 9  # points per axis that stand for the noise
TOLERANCE = 1e-6  # sweeps without a number stop when no value changes by more


def plan_rooms(
    tasks: Rooms, index: int, sweeps: int | None = Rooms.horizon, kappa: float | None = None
) -> GridPlan:
    """Optimal values of task `index` with `sweeps` steps to go, or endlessly with None.

    With `kappa` the mellow Bellman operator (eq. 5.3) takes the place of the optimal one.
    """
    copies, noise = tasks.select([index] * CHUNK), gaussian_quadrature(QUADRATURE)
    nodes, locate = make_grid(tasks)
    transition, reward = make_model(copies, nodes, locate, noise)

    def backup(values: Tensor) -> Tensor:
        onward = torch.from_numpy(transition @ values.numpy())
        q = (reward + Rooms.gamma * onward).view(-1, Rooms.n_actions)
        return q.amax(1) if kappa is None else mellowmax(q, kappa, 1)

    left, tolerance = (None, TOLERANCE) if sweeps is None else (sweeps - 1, 0.0)
    return GridPlan(copies, locate, noise, sweep(backup, len(nodes), left, tolerance))


def make_grid(tasks: Rooms) -> tuple[Tensor, Locate]:
    """Nodes (N, 2) of one rectangular grid per room, and how to locate states among them.

    No interpolation reaches through a wall. Nodes are ordered room by room, row by row.
    """
    edges = torch.cat([torch.zeros(1), tasks.walls, torch.full((1,), SIDE)])
    bottom, top = edges[:-1], edges[1:].clone()
    # A wall belongs to the room above it, and the room below ends just short of it.
    top[:-1] = torch.nextafter(top[:-1], bottom[:-1])
    columns = round(SIDE / SPACING) + 1
    rows = max(2, round(float((top - bottom).max()) / SPACING) + 1)
    ends = zip(bottom.tolist(), top.tolist(), strict=True)
    heights = torch.stack([torch.linspace(low, high, rows) for low, high in ends])
    heights = torch.minimum(heights, top[:, None]).flatten()
    nodes = torch.cartesian_prod(heights, torch.linspace(0, SIDE, columns)).flip(1)
    cell = (top - bottom) / (rows - 1)

    def locate(state: Tensor) -> tuple[Tensor, Tensor]:
        room = tasks.room(state)
        up = (state[:, 1] - bottom[room]) / cell[room]
        across = state[:, 0] / (SIDE / (columns - 1))
        cells = torch.tensor([rows - 1.0, columns - 1.0])
        (row, column), weight = around(torch.stack([up, across]), cells)
        return (row + room.unsqueeze(1) * rows) * columns + column, weight

    return nodes, locate


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


def make_model(
    copies: Rooms, nodes: Tensor, locate: Locate, noise: Tensor
) -> tuple[csr_array, Tensor]:
    """The task over a grid's nodes: transition (N A, N), sparse, and expected reward (N A,).

    Averages `Rooms.step` itself over the noises (K, 2), from every node with every action, action
    fastest. Rows sum to at most one: a step that ends an episode goes nowhere.
    """
    parts, rewards = [], []
    for some in nodes.split(CHUNK):
        reached, reward, terminated = try_out(copies, some, noise)
        index, weight = locate(reached)
        weight = weight * ~terminated.unsqueeze(1) / len(noise)
        rewards.append(reward.view(-1, len(noise)).mean(1))
        # Many noises end among the same nodes, whose entries are summed.
        starts = np.arange(len(rewards[-1]) + 1) * (index.shape[1] * len(noise))
        entries = weight.flatten().numpy(), index.flatten().numpy(), starts
        part = csr_array(entries, shape=(len(starts) - 1, len(nodes)))
        part.sum_duplicates()
        parts.append(part)
    return vstack(parts, "csr"), torch.cat(rewards)
