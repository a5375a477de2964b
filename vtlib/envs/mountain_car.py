"""Mountain car (thesis section 6.2.2): batched dynamics of many tasks, and their family."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from vtlib.envs.batch import ParameterBatch

GRAVITY = 0.0025
MAX_SPEED = 0.07
POSITIONS = (-1.2, 0.6)
STARTS = (-0.9, 0.0)
GOAL = 0.5
ACTIONS = ("LEFT", "NONE", "RIGHT")


@dataclass(frozen=True, eq=False)
class MountainCar(ParameterBatch):
    """A batch of R mountain car tasks; the dynamics are pure functions of their arguments.

    `speed` (R,) float32 is the velocity that an action adds in one step, 0.001 in Gymnasium.  A
    state is the car's position, in [-1.2, 0.6], and its velocity per step, in [-0.07, 0.07]; the
    hill's height is sin(3 position).  Raises ValueError on values that are not positive or another
    shape.  Source: thesis section 6.2.2, with the equations of Gymnasium's MountainCar-v0.
    """

    speed: Tensor

    n_actions: ClassVar[int] = 3
    obs_dim: ClassVar[int] = 2
    noise_dim: ClassVar[int] = 0
    start_dim: ClassVar[int] = 1
    horizon: ClassVar[int] = 200
    gamma: ClassVar[float] = 0.99

    def start(self, u: Tensor) -> Tensor:
        """First states (R, 2), at rest in [-0.9, 0), from uniform numbers `u` (R, 1) in [0, 1)."""
        low, high = STARTS
        return torch.cat([low + (high - low) * u, torch.zeros_like(u)], 1)

    def step(self, state: Tensor, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Drive every car once: next state (R, 2), reward (R,) float32, terminal (R,) bool.

        `state` (R, 2), `action` (R,) int64, 0 for left, 1 for none and 2 for right, `noise` (R, 0).
        The reward is -1, and 0 at the step that reaches the goal.  Raises ValueError when a shape
        is another one.
        """
        self._check_step(state, action, noise)
        position, velocity = state.unbind(1)
        velocity = velocity + ((action - 1) * self.speed - GRAVITY * (3 * position).cos())
        velocity = velocity.clamp(-MAX_SPEED, MAX_SPEED)
        position = (position + velocity).clamp(*POSITIONS)
        # Only the left end of the track is a wall; the goal lies before the right one.
        at_wall = (position <= POSITIONS[0]) & (velocity < 0)
        terminal = position >= GOAL
        next_state = torch.stack([position, velocity.masked_fill(at_wall, 0.0)], 1)
        return next_state, terminal.float() - 1, terminal


@dataclass(frozen=True)
class MountainCarFamily:
    """Mountain car tasks with a speed uniform in [0.001, 0.0015] (thesis section 6.2.2)."""

    def sample(self, rng: np.random.Generator, count: int) -> MountainCar:
        """Draw `count` tasks, independent and alike.  Raises ValueError when count < 1."""
        return MountainCar.uniform(rng, count, speed=(0.001, 0.0015))

    def join(self, tasks: Sequence[MountainCar]) -> MountainCar:
        """All tasks of several batches, in their order.  Raises ValueError when there is none."""
        return MountainCar.concatenate(tasks)
