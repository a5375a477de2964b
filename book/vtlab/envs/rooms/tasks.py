"""The rooms problem (thesis section 6.1): batched dynamics of many tasks."""

from __future__ import annotations

from typing import ClassVar

import torch
from attrs import field, frozen
from numpy.typing import ArrayLike
from torch import Tensor

from vtlab.envs.base import TaskBatch, float_array
from vtlib.checks import kind

SIDE = 10.0
STEP_LENGTH = 1.0
NOISE_SCALE = 0.2
DOOR_WIDTH = 1.0
GOAL = (SIDE, SIDE)  # a corner: `step` uses that both coordinates are SIDE
GOAL_RADIUS = 1.0
DOOR_RANGE = (DOOR_WIDTH / 2, SIDE - DOOR_WIDTH / 2)
_DIRECTIONS = [[0.0, 1.0], [1.0, 0.0], [0.0, -1.0], [-1.0, 0.0]]
_MOVES = STEP_LENGTH * torch.tensor(_DIRECTIONS, dtype=torch.float32)


@frozen(eq=False, slots=False)
class Rooms(TaskBatch):
    """A batch of R rooms tasks in a square 10 wide.

    `doors` (R, W) float32 are the centres of the doors, in [0.5, 9.5], lowest wall first; `walls`
    (W,) float32 are the walls' heights, increasing; `uniform_start` starts episodes anywhere in the
    square instead of at (0, 0); agents slide along the square's outer wall, unless it `stops` them
    as inner walls do. Raises ValueError for doors elsewhere.
    """

    doors: Tensor
    walls: Tensor
    uniform_start: bool = field(default=False, validator=kind(bool))
    stops: bool = field(default=False, validator=kind(bool))

    parameters: ClassVar[tuple[str, ...]] = ("doors",)
    n_actions: ClassVar[int] = 4
    state_dim: ClassVar[int] = 2
    obs_dim: ClassVar[int] = 2
    noise_dim: ClassVar[int] = 2
    start_dim: ClassVar[int] = 2
    horizon: ClassVar[int] = 50
    gamma: ClassVar[float] = 0.99

    def __attrs_post_init__(self) -> None:
        low, high = DOOR_RANGE
        # Written so that NaN is refused too.
        wrong = ~((self.doors >= low) & (self.doors <= high))
        if bool(wrong.any()):
            raise ValueError(f"doors must lie in [{low:g}, {high:g}], got {self.doors[wrong][0]:g}")

    @classmethod
    def from_doors(
        cls, doors: ArrayLike, uniform_start: bool = False, stops: bool = False
    ) -> Rooms:
        """Tasks with doors (R, W), and rooms of equal height."""
        centres = torch.from_numpy(float_array("doors", doors))
        if centres.ndim != 2 or centres.shape[1] == 0:
            raise ValueError(f"doors must have shape (R, W), got {tuple(centres.shape)}")
        rooms = centres.shape[1] + 1
        return cls(centres, SIDE * torch.arange(1, rooms) / rooms, uniform_start, stops)

    def start(self, u: Tensor) -> Tensor:
        """First states (R, 2) from uniform numbers `u` (R, 2) in [0, 1)."""
        return SIDE * u if self.uniform_start else torch.zeros_like(u)

    def step(self, state: Tensor, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Move every agent once; `action` is 0 for up, 1 for right, 2 for down and 3 for left."""
        self._check_step(state, action, noise)
        # Scaling and adding are separate operations, each of which rounds: whether a kernel fuses
        # them may depend on the row's place in the batch.
        aimed = state + _MOVES[action] + NOISE_SCALE * noise
        proposed = aimed.clamp(0.0, SIDE)
        blocked = self._blocked(state, proposed)
        if self.stops:
            blocked = blocked | (aimed != proposed).any(1, keepdim=True)
        next_state = torch.where(blocked, state, proposed)
        offset = SIDE - next_state
        terminated = (offset * offset).sum(1) <= GOAL_RADIUS**2
        return next_state, terminated.float(), terminated

    def room(self, state: Tensor) -> Tensor:
        """Index (R,) of the room of each state (R, 2), 0 at the bottom; a wall belongs above."""
        return torch.bucketize(state[:, 1].contiguous(), self.walls, right=True)

    def _blocked(self, state: Tensor, proposed: Tensor) -> Tensor:
        """Whether the segment from state to proposed crosses a wall outside its door: (R, 1)."""
        x, y = state.split(1, 1)
        dx, dy = (proposed - state).split(1, 1)
        # A point on a wall counts as above it, before and after the step, so that nobody can stop
        # on the line and go on to the other side.
        crosses = (y < self.walls) != (proposed[:, 1:] < self.walls)
        # dy is never 0 where a wall is crossed, and `crosses` masks the other places.
        x_at_wall = x + dx * ((self.walls - y) / dy)
        outside = (x_at_wall - self.doors).abs() > DOOR_WIDTH / 2
        return torch.any(crosses & outside, 1, keepdim=True)
