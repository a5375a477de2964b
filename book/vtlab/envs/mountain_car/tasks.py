"""Mountain car (thesis section 6.2.2): batched dynamics of many tasks."""

from typing import ClassVar

import torch
from attrs import frozen
from torch import Tensor

from vtlab.envs.base import ParameterBatch

GRAVITY = 0.0025
MAX_SPEED = 0.07
POSITIONS = (-1.2, 0.6)
GOAL = 0.5


@frozen(eq=False, slots=False)
class MountainCar(ParameterBatch):
    """A batch of R mountain car tasks, with the equations of Gymnasium's MountainCar-v0.

    `speed` (R,) is the velocity that an action adds in one step; `last_reward` is what the step to
    the goal earns, every other one -1. States (R, 2) are as `MountainCarEnv` lists them.
    """

    speed: Tensor
    last_reward: float = 0.0

    parameters: ClassVar[tuple[str, ...]] = ("speed",)
    n_actions: ClassVar[int] = 3
    state_dim: ClassVar[int] = 2
    obs_dim: ClassVar[int] = 2
    start_dim: ClassVar[int] = 1
    horizon: ClassVar[int] = 200
    gamma: ClassVar[float] = 0.99

    def start(self, u: Tensor) -> Tensor:
        """First states (R, 2), at rest in [-0.9, 0), from uniform numbers `u` (R, 1) in [0, 1)."""
        return torch.cat([-0.9 + 0.9 * u, torch.zeros_like(u)], 1)

    def step(self, state: Tensor, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Drive every car once; `action` is 0 for left, 1 for none and 2 for right."""
        self._check_step(state, action, noise)
        position, velocity = state.unbind(1)
        velocity = velocity + ((action - 1) * self.speed - GRAVITY * (3 * position).cos())
        velocity = velocity.clamp(-MAX_SPEED, MAX_SPEED)
        position = (position + velocity).clamp(*POSITIONS)
        # Only the left end of the track is a wall; the goal lies before the right one.
        at_wall = (position <= POSITIONS[0]) & (velocity < 0)
        terminated = position >= GOAL
        next_state = torch.stack([position, velocity.masked_fill(at_wall, 0.0)], 1)
        reward = torch.where(terminated, self.last_reward, -1.0)
        return next_state, reward, terminated
