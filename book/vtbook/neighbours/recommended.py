"""Variational transfer with one setting for all tasks, without asking whether sources suffice."""

from __future__ import annotations

from typing import ClassVar

import torch
from attrs import field, frozen
from torch import Tensor

from vtbook.stability import largest_step
from vtlib.checks import between, whole
from vtlib.qfunctions import QFunction
from vtlib.rng import Rng
from vtlib.transfer import Settings
from vtlib.trust import CLIP, NARROW
from vtlib.units import FIRST, InUnits

SAMPLES = 5  # from each component
WORTH = 0.5  # how many transitions the prior counts for
SHARE = 0.25  # the step on L as a share of the largest safe one; the components share it


@frozen
class Recommended:
    """Parameters of a mixture that starts at the first sources, in units of the sources.

    components: C of the mixture. updates: gradient steps for each step of the environment, but none
    in the first 64. gamma: discount. Raises ValueError for a value outside its range.
    """

    transfers: ClassVar[bool] = True

    components: int = field(default=3, validator=whole())
    updates: int = field(default=4, validator=whole())
    gamma: float = field(default=0.99, validator=between(0, 1, below=True))

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> InUnits:
        """An agent that transfers from sources (R, S, d)."""
        step = SHARE * float(largest_step(torch.tensor(float(q.d)), SAMPLES))
        settings = Settings(
            components=self.components,
            gamma=self.gamma,
            lambda_=WORTH * NARROW**2,
            minibatch=100,
            buffer=50_000,
            n_samples=SAMPLES,
            alpha_L=step,
            sigma_p2=NARROW**2,
            clip=CLIP,
            patience=FIRST,
            responsibilities="equal",
        )
        return InUnits(q, sources, obs_dim, settings, self.updates, rng)
