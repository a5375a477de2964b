"""Cartpoles whose pushes come one step late and whose state is measured with noise."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import torch
from attrs import frozen
from torch import Tensor

from vtlab.envs.cartpole import CartpoleFamily
from vtlab.envs.cartpole.tasks import Cartpole

NOISE = 0.02  # deviation of what is measured, in m, m/s, rad and rad/s


@frozen(eq=False, slots=False)
class NoisyCartpole(Cartpole):
    """Cartpoles (R,) that a push reaches one step late; the first push is to the left.

    States (R, 9) are the four of a cartpole, the error with which each is measured, and the push
    that is under way.
    """

    state_dim: ClassVar[int] = 9
    noise_dim: ClassVar[int] = 4

    def start(self, u: Tensor) -> Tensor:
        """First states (R, 9), measured without error."""
        return torch.cat([super().start(u), torch.zeros(len(u), 5)], 1)

    def observe(self, state: Tensor) -> Tensor:
        """Observations (R, 4): the cartpoles' states with the errors added."""
        return state[:, :4] + state[:, 4:8]

    def step(self, state: Tensor, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Push every cart by what was chosen one step ago."""
        self._check_step(state, action, noise)
        pole = Cartpole(self.cart_mass, self.pole_mass, self.half_length)
        late = state[:, 8].long()
        moved, reward, terminated = pole.step(state[:, :4], late, noise[:, :0])
        under_way = action.unsqueeze(1).to(moved)
        return torch.cat([moved, NOISE * noise, under_way], 1), reward, terminated


@frozen
class NoisyCartpoleFamily(CartpoleFamily):
    """Cartpole tasks as before, late and measured with noise."""

    kernel = ""

    def sample(self, rng: np.random.Generator, count: int) -> NoisyCartpole:
        plain = super().sample(rng, count)
        return NoisyCartpole.of(count, **{x: getattr(plain, x) for x in plain.parameters})
