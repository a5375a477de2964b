"""Maze navigation (thesis section 6.3): batched dynamics of many mazes, and their family."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from vtlib.checks import check_kind, check_one_of, check_whole, shown
from vtlib.envs.batch import checked_rows
from vtlib.envs.maze_geometry import CLEARANCE, SIDE, Ground, advance, directions, look
from vtlib.envs.mazes import Maze, library, named

STEP_LENGTH = 0.5  # m
TURN = math.pi / 8  # rad
NOISE_SCALE = 0.05  # m, and rad
SENSORS = 9
# Of the rays, rad from the heading to the left.  A hair off, for a ray that passes exactly through
# the point where two walls touch, as with heading 0 from a cell's middle, would see between them.
ANGLES = np.linspace(-math.pi / 2, math.pi / 2, SENSORS) + 1e-10
ACTIONS = ("FORWARD", "LEFT", "RIGHT")
_EFFECTS = np.array([[STEP_LENGTH, 0.0, 0.0], [0.0, TURN, -TURN]])  # m ahead, rad to the left


@dataclass(frozen=True, eq=False)
class Mazes:
    """A batch of R mazes, one per row; the dynamics are pure functions of their arguments.

    A maze is a square of 10 x 10 cells, 1 m wide and counted from the bottom left.  `walls`
    (R, 10, 10) bool tells at [row, x, y] which cells are walls; `goal` (R, 2) int64 is the goal's
    cell (x, y), a corner.  A state is the position x, y (m) and the heading (rad in [0, 2 pi], 0
    along x, pi / 2 along y).  Raises ValueError on another shape or type, a goal elsewhere or in a
    wall, or no other free cell.  Source: thesis section 6.3.
    """

    walls: Tensor
    goal: Tensor

    n_actions: ClassVar[int] = 3
    obs_dim: ClassVar[int] = 4 + 2 * SENSORS
    noise_dim: ClassVar[int] = 3
    start_dim: ClassVar[int] = 4
    horizon: ClassVar[int] = 100
    gamma: ClassVar[float] = 0.99

    def __post_init__(self) -> None:
        check_kind("walls", self.walls, Tensor)
        check_kind("goal", self.goal, Tensor)
        _check_types(self.walls, self.goal)
        _check_goals(self.walls, self.goal)

    @classmethod
    def of(cls, mazes: Sequence[str | Maze]) -> Mazes:
        """One task per maze, in their order; a maze is one of one's own or a name in the library.

        Raises ValueError when there is none, or on an unknown name.
        """
        if not len(mazes):
            raise ValueError("there must be at least one maze")
        drawn = [named(maze) if isinstance(maze, str) else maze for maze in mazes]
        for maze in drawn:
            check_kind("maze", maze, Maze)
        walls, goal = np.stack([maze.walls for maze in drawn]), [maze.goal for maze in drawn]
        return cls(torch.from_numpy(walls), torch.tensor(goal))

    def __len__(self) -> int:
        return len(self.walls)

    def start(self, u: Tensor) -> Tensor:
        """First states (R, 3) from uniform numbers `u` (R, 4) in [0, 1).

        The cell is any free one but the goal's, the position anywhere in it but a rim of 1 cm, the
        heading any; all uniform.
        """
        order, count = self._starts
        share, *within, turn = _columns(u)
        # A share just below 1 may be rounded to the count itself.
        choice = np.minimum((share * count).astype(np.int64), count - 1)
        cell = np.divmod(order[np.arange(len(self)), choice], SIDE)
        position = np.stack(cell) + CLEARANCE + (1 - 2 * CLEARANCE) * np.stack(within)
        return _rows(position, 2 * math.pi * turn[None])

    def step(self, state: Tensor, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Move every robot once: next state (R, 3), reward (R,) float32, terminal (R,) bool.

        `state` (R, 3), `action` (R,) int64 in 0..2 for forward, left and right, `noise` (R, 3)
        standard normal.  Raises ValueError when a shape is another one.
        """
        self._check_step(state, action, noise)
        pose, jolt = _columns(state), NOISE_SCALE * _columns(noise)
        forward, turn = _EFFECTS[:, action.numpy()]
        move = forward * directions(pose[2]) + jolt[:2]
        position = advance(self._ground, pose[:2], move)
        heading = (pose[2] + turn + jolt[2]) % (2 * math.pi)
        next_state = _rows(position, heading[None])
        terminal = (next_state[:, :2].floor() == self.goal).all(1)
        return next_state, terminal.float(), terminal

    def observe(self, state: Tensor) -> Tensor:
        """Observations (R, 22) float32 of the states (R, 3).

        Position x, y in m; cosine and sine of the heading; the distance in m, at most 2, to the
        first wall or border along 9 rays from 90 degrees right of the heading to 90 left of it; for
        each ray 1 where it meets the goal's cell before a wall and within 2 m, else 0.
        """
        pose = _columns(state)
        rays = directions(pose[2] + ANGLES[:, None])
        distance, flag = look(self._ground, pose[:2], rays)
        return _rows(pose[:2], rays[:, SENSORS // 2], distance, flag)

    def select(self, index: Tensor | np.ndarray | Sequence[int]) -> Mazes:
        """The tasks at `index`, in that order; an index may repeat.  Raises ValueError outside."""
        rows = checked_rows(index, len(self))
        return Mazes(self.walls[rows], self.goal[rows])

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

    def _check_step(self, state: Tensor, action: Tensor, noise: Tensor) -> None:
        runs = len(self)
        shapes = (runs, 3), (runs,), (runs, 3)
        got = tuple(state.shape), tuple(action.shape), tuple(noise.shape)
        if got != shapes:
            raise ValueError(f"state, action, noise must have shapes {shapes}, got {got}")


@dataclass(frozen=True)
class MazeFamily:
    """Mazes of the library, each of `names` as likely; all twenty unless told otherwise.

    Raises ValueError when there is no name, or an unknown one.
    """

    names: tuple[str, ...] = field(default_factory=lambda: tuple(library()))

    def __post_init__(self) -> None:
        if not (isinstance(self.names, tuple) and self.names):
            raise ValueError(f"names must be a tuple of at least one, got {shown(self.names)}")
        for name in self.names:
            check_one_of("names", name, library())

    def sample(self, rng: np.random.Generator, count: int) -> Mazes:
        """Draw `count` tasks, independent and alike.  Raises ValueError when count < 1."""
        check_whole("count", count)
        return Mazes.of([self.names[i] for i in rng.integers(len(self.names), size=count)])

    def join(self, tasks: Sequence[Mazes]) -> Mazes:
        """All tasks of several batches, in their order.  Raises ValueError when there is none."""
        if not tasks:
            raise ValueError("there must be at least one batch of tasks to join")
        return Mazes(torch.cat([t.walls for t in tasks]), torch.cat([t.goal for t in tasks]))


def _columns(rows: Tensor) -> np.ndarray:
    """The transpose in float64: numbers of one kind lie side by side."""
    return rows.numpy().T.astype(np.float64, order="C")


def _rows(*columns: np.ndarray) -> Tensor:
    """Arrays (n, R), each with its own n, as one tensor (R, sum of n) float32."""
    rows = np.empty((columns[0].shape[1], sum(map(len, columns))), np.float32)
    np.concatenate(columns, out=rows.T, casting="unsafe")
    return torch.from_numpy(rows)


def _check_types(walls: Tensor, goal: Tensor) -> None:
    if walls.ndim != 3 or walls.shape[1:] != (SIDE, SIDE) or walls.dtype != torch.bool:
        raise ValueError(
            f"walls must be bool of shape (R, {SIDE}, {SIDE}), "
            f"got {walls.dtype} of {tuple(walls.shape)}"
        )
    if goal.shape != (len(walls), 2) or goal.dtype != torch.int64:
        raise ValueError(
            f"goal must be int64 of shape ({len(walls)}, 2), got {goal.dtype} of "
            f"{tuple(goal.shape)}"
        )


def _check_goals(walls: Tensor, goal: Tensor) -> None:
    outside = ~((goal == 0) | (goal == SIDE - 1)).all(1)
    if outside.any():
        raise ValueError(f"a goal must be a corner cell, got {tuple(goal[outside][0].tolist())}")
    if walls[torch.arange(len(walls)), goal[:, 0], goal[:, 1]].any():
        raise ValueError("a goal must not be a wall")
    if ((~walls).sum((1, 2)) < 2).any():
        raise ValueError("a maze must have a free cell beside the goal's")
