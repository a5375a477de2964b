"""The settings that we recommend: variational transfer in units in which one setting can serve.

Weights are measured in units of the sources, u, the root of their mean square. The squared TD error
is divided by its largest curvature, eta (``vtlib.stability``), which the agent takes from what it
remembers. In these units the prior, the weight of the divergence and the step on L are the same for
every task: the step is a share of the largest that is safe.
"""

from __future__ import annotations

from typing import ClassVar, Protocol

import torch
from attrs import field, frozen
from torch import Tensor

from vtlib.checks import between, check_kind, check_weights, whole
from vtlib.qfunctions import QFunction
from vtlib.replay import Transition
from vtlib.rng import Rng
from vtlib.stability import curvature, largest_step
from vtlib.transfer import Settings, VariationalTransfer

NARROW = 0.003  # standard deviation of the prior's components
WORTH = 0.5  # how many transitions the prior counts for
SAMPLES = 5  # from each component
SHARE = 0.25  # the step on L as a share of the largest safe one; the components share it
CLIP = 1.0  # bound on a gradient's entries, which only a run that explodes reaches
FLAT = 1e-30  # least curvature, so that nothing is divided by zero
FIRST = 64  # transitions that are only remembered
MEASURED = 200  # transitions from which eta is measured


@frozen
class Recommended:
    """Parameters of the recommended method, the same for every task.

    components: C of the mixture, which start at the first sources, again from the first where there
    are fewer. updates: gradient steps for each step of the environment, but none in the first 64.
    gamma: discount. Raises ValueError for a value outside its range.
    """

    transfers: ClassVar[bool] = True

    components: int = field(default=3, validator=whole())
    updates: int = field(default=4, validator=whole())
    gamma: float = field(default=0.99, validator=between(0, 1, below=True))

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> InUnits:
        """An agent that transfers from sources (R, S, d)."""
        return InUnits(q, sources, obs_dim, self, rng)

    def in_units(self, d: int) -> Settings:
        """The parameters of variational transfer of d weights in these units."""
        return Settings(
            components=self.components,
            gamma=self.gamma,
            lambda_=WORTH * NARROW**2,
            minibatch=100,
            buffer=50_000,
            n_samples=SAMPLES,
            alpha_L=SHARE * float(largest_step(torch.tensor(float(d)), SAMPLES)),
            sigma_p2=NARROW**2,
            clip=CLIP,
            patience=FIRST,
            responsibilities="equal",
        )


class InUnitsSettings(Protocol):
    """What ``InUnits`` needs of its settings."""

    @property
    def updates(self) -> int:
        """Gradient steps for each step of the environment."""

    def in_units(self, d: int) -> Settings:
        """The parameters of variational transfer of d weights in units of the sources."""


class InUnits(VariationalTransfer):
    """``VariationalTransfer`` of w / u, on gradients divided by eta, several times a step.

    eta is measured at the first component's mean when 64, 128, 256, ... transitions are remembered,
    and never falls. Raises ValueError for sources that are missing, not finite, all zero, not
    float32 or not of the Q-function's shape.
    """

    def __init__(
        self, q: QFunction, sources: Tensor, obs_dim: int, settings: InUnitsSettings, rng: Rng
    ) -> None:
        check_kind("sources", sources, Tensor)
        check_weights("sources", sources, "run", "source", q.d)
        sources = sources.detach()
        self._unit = sources.square().mean((1, 2), keepdim=True).sqrt()
        if not bool(((self._unit > 0) & self._unit.isfinite()).all()):
            raise ValueError(
                "sources must be neither all zero nor huge: weights are scaled by them"
            )
        self._eta, self._places = torch.zeros_like(self._unit), rng.stream("curvature")
        self._updates = settings.updates
        super().__init__(q, sources / self._unit, obs_dim, settings.in_units(q.d), rng)

    @property
    def mu(self) -> Tensor:
        """The posterior's means (R, C, d)."""
        return self._posterior.mu.detach() * self._unit

    @property
    def scale_tril(self) -> Tensor:
        """The posterior's Cholesky factors, (R, C, d, d)."""
        return self._posterior.scale_tril * self._unit.unsqueeze(-1)

    @property
    def deviations(self) -> Tensor | None:
        """Standard deviations (R, C, d) of a diagonal posterior, which a large network has."""
        deviations = super().deviations
        return None if deviations is None else deviations * self._unit

    def learn(self, transition: Transition) -> None:
        """Store one transition of each run and take some gradient steps on eq. 5.2."""
        super().learn(transition)
        for _ in range(self._updates - 1):
            self.update()
        if self._steps >= FIRST and self._steps.bit_count() == 1:
            self._measure()

    def _measure(self) -> None:
        s, batch = self._settings, self.remembered(self._places.uniform(MEASURED))
        batch = Transition(*(x.to(self._device) for x in batch))
        eta = curvature(self._q, self.mu[:, 0], batch, s.psi, s.gamma, s.kappa)
        self._eta = torch.maximum(self._eta, eta.view(-1, 1, 1).to(self._eta) * self._unit**2)

    def _gradients(self, w: Tensor, batch: Transition) -> Tensor:
        scale = self._unit / self._eta.clamp(min=FLAT)
        return super()._gradients(w * self._unit, batch).mul_(scale)

    def _thompson(self) -> Tensor:
        return super()._thompson() * self._unit
