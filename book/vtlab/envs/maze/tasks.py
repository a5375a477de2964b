"""Maze navigation (thesis section 6.3): batched dynamics of many mazes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import ClassVar

import numpy as np
import torch
from attrs import frozen
from torch import Tensor

from vtlab.envs.base import TaskBatch
from vtlab.envs.maze.geometry import CLEARANCE, SIDE, Ground, advance, directions, look
from vtlab.envs.maze.library import library
from vtlib.checks import check_one_of

STEP_LENGTH = 0.5  # m
TURN = math.pi / 8  # rad
NOISE_SCALE = 0.05  # m, and rad
SENSORS = 9
# Angles of the rays, rad from the heading to the left. They are a hair off, or a ray from a cell's
# middle could pass exactly through the point where two walls touch.
ANGLES = np.linspace(-math.pi / 2, math.pi / 2, SENSORS) + 1e-10
_EFFECTS = np.array([[STEP_LENGTH, 0.0, 0.0], [0.0, TURN, -TURN]])  # m ahead, rad to the left


@frozen(eq=False, slots=False)
class Mazes(TaskBatch):
    """A batch of R mazes of 10 x 10 cells, 1 m wide and counted from the bottom left.

    `walls` (R, 10, 10) bool tells at [row, x, y] which cells are walls; `goal` (R, 2) int64 is the
    goal's cell (x, y), a corner. A state is the position x, y (m) and the heading (rad in
    [0, 2 pi], 0 along x, pi / 2 along y).
    """

    walls: Tensor
    goal: Tensor

    parameters: ClassVar[tuple[str, ...]] = ("walls", "goal")
    n_actions: ClassVar[int] = 3
    state_dim: ClassVar[int] = 3
    obs_dim: ClassVar[int] = 4 + 2 * SENSORS
    noise_dim: ClassVar[int] = 3
    start_dim: ClassVar[int] = 4
    horizon: ClassVar[int] = 100
    gamma: ClassVar[float] = 0.99

    @classmethod
    def of(cls, names: Sequence[str]) -> Mazes:
        """One task for each of at least one maze of the library."""
        if not len(names):
            raise ValueError("there must be at least one maze")
        for name in names:
            check_one_of("maze", name, library())
        batch = [library()[name] for name in names]
        walls, goal = np.stack([maze.walls for maze in batch]), [maze.goal for maze in batch]
        return cls(torch.from_numpy(walls), torch.tensor(goal))

    def start(self, u: Tensor) -> Tensor:
        """First states (R, 3) from `u` (R, 4) in [0, 1): cell but the goal's, place, heading."""
        order, count = self._starts
        share, *within, turn = _columns(u)
        # A share just below 1 may be rounded to the count itself.
        choice = np.minimum((share * count).astype(np.int64), count - 1)
        cell = np.divmod(order[np.arange(len(self)), choice], SIDE)
        position = np.stack(cell) + CLEARANCE + (1 - 2 * CLEARANCE) * np.stack(within)
        return _rows(position, 2 * math.pi * turn[None])

    def step(self, state: Tensor, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Move every robot once; `action` is 0 for forward, 1 for left and 2 for right."""
        self._check_step(state, action, noise)
        pose, jolt = _columns(state), NOISE_SCALE * _columns(noise)
        forward, turn = _EFFECTS[:, action.numpy()]
        move = forward * directions(pose[2]) + jolt[:2]
        position = advance(self._ground, pose[:2], move)
        heading = (pose[2] + turn + jolt[2]) % (2 * math.pi)
        next_state = _rows(position, heading[None])
        terminated = (next_state[:, :2].floor() == self.goal).all(1)
        return next_state, terminated.float(), terminated

    def observe(self, state: Tensor) -> Tensor:
        """Observations (R, 22) float32 of the states (R, 3), as `MazeEnv` lists them."""
        pose = _columns(state)
        rays = directions(pose[2] + ANGLES[:, None])
        distance, flag = look(self._ground, pose[:2], rays)
        return _rows(pose[:2], rays[:, SENSORS // 2], distance, flag)

    @cached_property
    def _ground(self) -> Ground:
        return Ground.of(self.walls.numpy(), self.goal.numpy())

    @cached_property
    def _starts(self) -> tuple[np.ndarray, np.ndarray]:
        """Cells (R, 100) as 10 x + y, those where episodes begin first, and their count (R,)."""
        closed = self.walls.numpy().copy()
        closed[(np.arange(len(self)), *self.goal.numpy().T)] = True
        closed = closed.reshape(len(self), -1)
        return closed.argsort(1, kind="stable"), (~closed).sum(1)


def _columns(rows: Tensor) -> np.ndarray:
    """The transpose in float64: numbers of one kind lie side by side."""
    return rows.numpy().T.astype(np.float64, order="C")


def _rows(*columns: np.ndarray) -> Tensor:
    """Arrays (n, R), each with its own n, as one tensor (R, sum of n) float32."""
    rows = np.empty((columns[0].shape[1], sum(map(len, columns))), np.float32)
    np.concatenate(columns, out=rows.T, casting="unsafe")
    return torch.from_numpy(rows)
