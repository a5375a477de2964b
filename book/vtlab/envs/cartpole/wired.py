"""Cartpoles of two wirings: sources of the same wiring as the target are useful, the others not.

In half of the tasks the two actions are exchanged. So about half of the sources balance the target
at once, and the other half push the wrong way. Nothing that an agent sees tells which is which.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from attrs import frozen
from torch import Tensor

from vtlab.envs.cartpole import CartpoleFamily
from vtlab.envs.cartpole.tasks import Cartpole

SWAPPED = 2.0  # of the wiring; the other is 1


@frozen(eq=False, slots=False)
class WiredCartpole(Cartpole):
    """Cartpoles (R,) whose actions are exchanged where ``wiring`` (R,) is 2."""

    wiring: Tensor

    parameters: ClassVar[tuple[str, ...]] = (*Cartpole.parameters, "wiring")

    def step(self, state: Tensor, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Push every cart once; action 0 is left, or where the wiring is 2, right."""
        swapped = self.wiring == SWAPPED
        return super().step(state, action ^ swapped, noise)


@frozen
class WiredCartpoleFamily(CartpoleFamily):
    """Cartpole tasks as before, each with one wiring or the other."""

    parameters = WiredCartpole.parameters
    kernel = ""

    def sample(self, rng: np.random.Generator, count: int) -> WiredCartpole:
        plain = super().sample(rng, count)
        wiring = rng.choice([1.0, SWAPPED], count)
        return WiredCartpole.of(
            count, **{name: getattr(plain, name) for name in plain.parameters}, wiring=wiring
        )
