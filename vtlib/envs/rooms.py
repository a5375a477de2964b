"""The rooms problem (thesis section 6.1): batched dynamics of many tasks, and the task families."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from vtlib.checks import check_between, check_kind, check_positive, check_whole, shown
from vtlib.envs.batch import checked_rows, float_array

SIDE = 10.0
STEP_LENGTH = 1.0
NOISE_SCALE = 0.2
DOOR_WIDTH = 1.0
GOAL = (SIDE, SIDE)  # a corner: `step` uses that both coordinates are SIDE
GOAL_RADIUS = 1.0
DOOR_RANGE = (DOOR_WIDTH / 2, SIDE - DOOR_WIDTH / 2)
ACTIONS = ("UP", "RIGHT", "DOWN", "LEFT")


@functools.cache
def _moves(device: torch.device) -> Tensor:
    directions = torch.tensor([[0.0, 1.0], [1.0, 0.0], [0.0, -1.0], [-1.0, 0.0]])
    return (STEP_LENGTH * directions).to(device)


def even_walls(count: int) -> Tensor:
    """Heights (count,) of walls that cut the square into count + 1 rooms of equal height."""
    return SIDE * torch.arange(1, count + 1) / (count + 1)


@dataclass(frozen=True, eq=False)
class Rooms:
    """A batch of R rooms tasks, one per row; the dynamics are pure functions of their arguments.

    `doors` (R, W) float32 are the centres of the doors, in [0.5, 9.5], lowest wall first; `walls`
    (W,) float32 are the walls' heights, increasing; `uniform_start` starts episodes anywhere in the
    square instead of at (0, 0).  Lengths are in the thesis' units (the square is 10 wide).  Raises
    ValueError on any other value or shape.  Source: thesis section 6.1.
    """

    doors: Tensor
    walls: Tensor
    uniform_start: bool = False

    n_actions: ClassVar[int] = 4
    obs_dim: ClassVar[int] = 2
    noise_dim: ClassVar[int] = 2
    start_dim: ClassVar[int] = 2
    horizon: ClassVar[int] = 50
    gamma: ClassVar[float] = 0.99

    def __post_init__(self) -> None:
        check_kind("walls", self.walls, Tensor)
        check_kind("doors", self.doors, Tensor)
        check_kind("uniform_start", self.uniform_start, bool)
        _check_walls(self.walls)
        _check_doors(self.doors, len(self.walls))

    @classmethod
    def from_doors(cls, doors: ArrayLike | Tensor, uniform_start: bool = False) -> Rooms:
        """Tasks with doors (R, W), or one task with doors (W,), and rooms of equal height."""
        if not isinstance(doors, Tensor):
            doors = torch.from_numpy(float_array("doors", doors))
        centres = doors.float()
        centres = centres[None] if centres.ndim == 1 else centres
        if centres.ndim != 2 or centres.shape[1] == 0:
            raise ValueError(f"doors must have shape (R, W) or (W,), got {tuple(centres.shape)}")
        return cls(centres, even_walls(centres.shape[1]).to(centres.device), uniform_start)

    def __len__(self) -> int:
        return len(self.doors)

    def start(self, u: Tensor) -> Tensor:
        """First states (R, 2) from uniform numbers `u` (R, 2) in [0, 1)."""
        return SIDE * u if self.uniform_start else torch.zeros_like(u)

    def step(self, state: Tensor, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Move every agent once: next state (R, 2), reward (R,) float32, terminal (R,) bool.

        `state` (R, 2), `action` (R,) int64 in 0..3, `noise` (R, 2) standard normal.  Raises
        ValueError when a shape is another one.
        """
        self._check_step(state, action, noise)
        # Scaling and adding stay separate operations, each rounded on its own: whether a kernel
        # fuses them may depend on the row's place in the batch.
        proposed = (state + _moves(state.device)[action] + NOISE_SCALE * noise).clamp(0.0, SIDE)
        next_state = torch.where(self._blocked(state, proposed), state, proposed)
        offset = SIDE - next_state
        terminal = (offset * offset).sum(1) <= GOAL_RADIUS**2
        return next_state, terminal.float(), terminal

    def observe(self, state: Tensor) -> Tensor:
        """Observations (R, 2) of the states (R, 2): the states themselves."""
        return state

    def room(self, state: Tensor) -> Tensor:
        """Index (R,) of the room of each state (R, 2), 0 at the bottom; a wall belongs above."""
        return torch.bucketize(state[:, 1].contiguous(), self.walls, right=True)

    def select(self, index: Tensor | np.ndarray | Sequence[int]) -> Rooms:
        """The tasks at `index`, in that order; an index may repeat.  Raises ValueError outside."""
        rows = checked_rows(index, len(self)).to(self.doors.device)
        return replace(self, doors=self.doors[rows])

    def to(self, device: torch.device | str) -> Rooms:
        """The same tasks on another device."""
        return replace(self, doors=self.doors.to(device), walls=self.walls.to(device))

    def _blocked(self, state: Tensor, proposed: Tensor) -> Tensor:
        """Whether the segment from state to proposed crosses a wall outside its door: (R, 1)."""
        x, y = state.split(1, 1)
        dx, dy = (proposed - state).split(1, 1)
        # A point on a wall counts as above it, before the step and after it: so nobody can stop
        # on the line and go on to the other side.
        crosses = (y < self.walls) != (proposed[:, 1:] < self.walls)
        # dy is never 0 where a wall is crossed; what it gives elsewhere is masked by `crosses`.
        x_at_wall = x + dx * ((self.walls - y) / dy)
        outside = (x_at_wall - self.doors).abs() > DOOR_WIDTH / 2
        blocked: Tensor = crosses & outside
        return blocked.any(1, keepdim=True)

    def _check_step(self, state: Tensor, action: Tensor, noise: Tensor) -> None:
        runs = len(self.doors)
        if state.shape != (runs, 2) or noise.shape != (runs, 2) or action.shape != (runs,):
            raise ValueError(
                f"state, action, noise must have shapes ({runs}, 2), ({runs},), ({runs}, 2), got "
                f"{tuple(state.shape)}, {tuple(action.shape)}, {tuple(noise.shape)}"
            )


def _check_walls(walls: Tensor) -> None:
    inside = walls.ndim == 1 and len(walls) > 0 and bool(((walls > 0) & (walls < SIDE)).all())
    if not inside or not bool((walls.diff() > 0).all()):
        raise ValueError(
            f"walls must be a vector of increasing heights inside (0, {SIDE:g}), "
            f"got {walls.tolist()}"
        )


def _check_doors(doors: Tensor, count: int) -> None:
    if doors.ndim != 2 or doors.shape[1] != count:
        raise ValueError(
            f"doors must have shape (R, {count}), one per wall, got {tuple(doors.shape)}"
        )
    if doors.dtype != torch.float32:
        raise ValueError(f"doors must be float32, got {doors.dtype}")
    low, high = DOOR_RANGE
    # Written so that NaN is refused too.
    wrong = ~((doors >= low) & (doors <= high))
    if bool(wrong.any()):
        value = doors[wrong][0].item()
        raise ValueError(f"doors must lie in [{low:g}, {high:g}], got {value:g}")


@dataclass(frozen=True)
class RoomsFamily:
    """A distribution over rooms tasks: doors uniform in [0.5, 9.5] unless told otherwise.

    `rooms` is 2 or 3; `fixed_lower` puts the lowest door at one place in every task (thesis
    6.1.2); `normal` = (mean, standard deviation) draws the doors from a Normal distribution,
    clipped to [0.5, 9.5] (thesis 6.1.4).  Raises ValueError on any other value.
    """

    rooms: int = 3
    fixed_lower: float | None = None
    normal: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        check_whole("rooms", self.rooms, 2, 3)
        if self.fixed_lower is not None:
            check_between("fixed_lower", self.fixed_lower, *DOOR_RANGE)
        if self.normal is not None:
            if not (isinstance(self.normal, tuple) and len(self.normal) == 2):
                raise ValueError(f"normal must be (mean, deviation), got {shown(self.normal)}")
            check_between("the mean in normal", self.normal[0], *DOOR_RANGE)
            check_positive("the deviation in normal", self.normal[1])

    def sample(self, rng: np.random.Generator, count: int) -> Rooms:
        """Draw `count` tasks, independent and alike.  Raises ValueError when count < 1."""
        check_whole("count", count)
        shape = (count, self.rooms - 1)
        if self.normal is None:
            doors = rng.uniform(*DOOR_RANGE, shape)
        else:
            doors = rng.normal(*self.normal, shape).clip(*DOOR_RANGE)
        if self.fixed_lower is not None:
            doors[:, 0] = self.fixed_lower
        return Rooms.from_doors(doors)

    def join(self, tasks: Sequence[Rooms]) -> Rooms:
        """All tasks of several batches, in their order.

        Raises ValueError when there is none, or when their walls or starts differ.
        """
        if not tasks:
            raise ValueError("there must be at least one batch of tasks to join")
        first = tasks[0]
        for other in tasks:
            if not torch.equal(other.walls, first.walls):
                raise ValueError(
                    f"joined tasks must have the same walls, got {first.walls.tolist()} "
                    f"and {other.walls.tolist()}"
                )
            if other.uniform_start != first.uniform_start:
                raise ValueError("joined tasks must start alike, got both kinds of start")
        return replace(first, doors=torch.cat([task.doors for task in tasks]))
