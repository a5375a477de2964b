"""Cartpole (thesis section 6.2.1): batched dynamics of many tasks, and their family."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from vtlib.envs.batch import ParameterBatch

GRAVITY = 9.8  # m/s^2
FORCE = 10.0  # N
TIME_STEP = 0.02  # s
POSITION_LIMIT = 2.4  # m
ANGLE_LIMIT = math.radians(12)
START_LIMIT = 0.05
ACTIONS = ("LEFT", "RIGHT")


@dataclass(frozen=True, eq=False)
class Cartpole(ParameterBatch):
    """A batch of R cartpole tasks; the dynamics are pure functions of their arguments.

    `cart_mass` and `pole_mass` (R,) are in kg, `half_length` (R,), from the pivot to the pole's
    centre of mass, in m; all float32.  A state is the cart's position (m) and velocity (m/s), the
    pole's angle (rad, 0 upright, positive to the right) and angular velocity (rad/s).  Raises
    ValueError on values that are not positive or shapes that differ.  Source: thesis section
    6.2.1, with the equations of Gymnasium's CartPole-v1.
    """

    cart_mass: Tensor
    pole_mass: Tensor
    half_length: Tensor

    n_actions: ClassVar[int] = 2
    obs_dim: ClassVar[int] = 4
    noise_dim: ClassVar[int] = 0
    start_dim: ClassVar[int] = 4
    horizon: ClassVar[int] = 100
    gamma: ClassVar[float] = 0.99

    def start(self, u: Tensor) -> Tensor:
        """First states (R, 4), in [-0.05, 0.05), from uniform numbers `u` (R, 4) in [0, 1)."""
        return START_LIMIT * (2 * u - 1)

    def step(self, state: Tensor, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Push every cart once: next state (R, 4), reward (R,) float32, terminal (R,) bool.

        `state` (R, 4), `action` (R,) int64, 0 for left and 1 for right, `noise` (R, 0).  The reward
        is 1, at the step that ends an episode too.  Raises ValueError when a shape is another one.
        """
        self._check_step(state, action, noise)
        _, velocity, angle, angular_velocity = state.unbind(1)
        angular_acceleration, acceleration = self._accelerations(angle, angular_velocity, action)
        # Euler's method: every rate is that before the step, as in Gymnasium.
        rates = [velocity, acceleration, angular_velocity, angular_acceleration]
        next_state = state + TIME_STEP * torch.stack(rates, 1)
        fallen = next_state[:, 2].abs() > ANGLE_LIMIT
        terminal = fallen | (next_state[:, 0].abs() > POSITION_LIMIT)
        return next_state, torch.ones_like(velocity), terminal

    def _accelerations(
        self, angle: Tensor, angular_velocity: Tensor, action: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Accelerations (R,) of the pole, in rad/s^2, and of the cart, in m/s^2."""
        sin, cos = angle.sin(), angle.cos()
        mass, moment = self.cart_mass + self.pole_mass, self.pole_mass * self.half_length
        force = FORCE * (2 * action - 1)
        push = (force + moment * angular_velocity.square() * sin) / mass
        inertia = self.half_length * (4 / 3 - self.pole_mass * cos.square() / mass)
        angular = (GRAVITY * sin - cos * push) / inertia
        return angular, push - moment * angular * cos / mass


@dataclass(frozen=True)
class CartpoleFamily:
    """Cartpole tasks with masses and half length uniform in the ranges of thesis section 6.2.1."""

    def sample(self, rng: np.random.Generator, count: int) -> Cartpole:
        """Draw `count` tasks, independent and alike.  Raises ValueError when count < 1."""
        return Cartpole.uniform(
            rng, count, cart_mass=(0.5, 1.5), pole_mass=(0.1, 0.3), half_length=(0.2, 1.0)
        )

    def join(self, tasks: Sequence[Cartpole]) -> Cartpole:
        """All tasks of several batches, in their order.  Raises ValueError when there is none."""
        return Cartpole.concatenate(tasks)
