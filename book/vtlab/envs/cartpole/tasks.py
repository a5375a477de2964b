"""Cartpole (thesis section 6.2.1): batched dynamics of many tasks."""

import math
from typing import ClassVar

import torch
from attrs import frozen
from torch import Tensor

from vtlab.envs.base import ParameterBatch

GRAVITY = 9.8  # m/s^2
FORCE = 10.0  # N
TIME_STEP = 0.02  # s
POSITION_LIMIT = 2.4  # m
ANGLE_LIMIT = math.radians(12)
START_LIMIT = 0.05


@frozen(eq=False, slots=False)
class Cartpole(ParameterBatch):
    """A batch of R cartpole tasks, with the equations of Gymnasium's CartPole-v1.

    Masses (R,) are in kg, `half_length` (R,), from the pivot to the pole's centre of mass, in m.
    States (R, 4) are as `CartpoleEnv` lists them.
    """

    cart_mass: Tensor
    pole_mass: Tensor
    half_length: Tensor

    parameters: ClassVar[tuple[str, ...]] = ("cart_mass", "pole_mass", "half_length")
    n_actions: ClassVar[int] = 2
    state_dim: ClassVar[int] = 4
    obs_dim: ClassVar[int] = 4
    start_dim: ClassVar[int] = 4
    horizon: ClassVar[int] = 100
    gamma: ClassVar[float] = 0.99

    def start(self, u: Tensor) -> Tensor:
        """First states (R, 4), in [-0.05, 0.05), from uniform numbers `u` (R, 4) in [0, 1)."""
        return START_LIMIT * (2 * u - 1)

    def step(self, state: Tensor, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Push every cart once; `action` is 0 for left and 1 for right, the reward always 1."""
        self._check_step(state, action, noise)
        _, velocity, angle, spin = state.unbind(1)
        sin, cos = angle.sin(), angle.cos()
        mass, moment = self.cart_mass + self.pole_mass, self.pole_mass * self.half_length
        push = (FORCE * (2 * action - 1) + moment * spin.square() * sin) / mass
        inertia = self.half_length * (4 / 3 - self.pole_mass * cos.square() / mass)
        turning = (GRAVITY * sin - cos * push) / inertia  # rad/s^2
        acceleration = push - moment * turning * cos / mass  # m/s^2
        # By Euler's method all rates are those before the step, as in Gymnasium.
        next_state = state + TIME_STEP * torch.stack([velocity, acceleration, spin, turning], 1)
        fallen = next_state[:, 2].abs() > ANGLE_LIMIT
        terminated = fallen | (next_state[:, 0].abs() > POSITION_LIMIT)
        return next_state, torch.ones_like(velocity), terminated
