"""Variational transfer in units in which one setting can serve many tasks.

Weights are measured in units of the sources, u, the root of their mean square. The squared TD error
is divided by its largest curvature, eta (``vtlib.stability``), which the agent takes from what it
remembers.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from vtlib.checks import check_weights
from vtlib.qfunctions import QFunction
from vtlib.replay import Transition
from vtlib.rng import Rng
from vtlib.stability import curvature
from vtlib.transfer import Settings, VariationalTransfer

FLAT = 1e-30  # least curvature, so that nothing is divided by zero
FIRST = 64  # transitions that are only remembered
MEASURED = 200  # transitions from which eta is measured
DIVERGED = 10.0  # how many times as large as most sources' the weights of a sound one may be
MOMENTS = "exp_avg", "exp_avg_sq"  # torch's names of Adam's


def sound(sources: Tensor) -> Tensor:
    """Which sources (S, d) are sound (S,): not so much larger than most that learning diverged.

    One such source would set the unit of all weights, and the mean that learning starts from.
    """
    size = sources.square().mean(1).sqrt()
    return size <= DIVERGED * size.quantile(0.5)


class InUnits(VariationalTransfer):
    """``VariationalTransfer`` of w / u, on gradients divided by eta, several times a step.

    settings are in these units; updates are the gradient steps for each step of the environment.
    eta is measured at the first component's mean when 64, 128, 256, ... transitions are remembered,
    and never falls. Raises as ``VariationalTransfer``, and ValueError for sources all zero.
    """

    def __init__(
        self,
        q: QFunction,
        sources: Tensor,
        obs_dim: int,
        settings: Settings,
        updates: int,
        rng: Rng,
    ) -> None:
        check_weights("sources", sources, "run", "source", q.d)
        sources = sources.detach()
        self._unit = sources.square().mean((1, 2), keepdim=True).sqrt()
        if not bool(((self._unit > 0) & self._unit.isfinite()).all()):
            raise ValueError("sources must be neither all zero nor huge: they are the unit")
        self._eta, self._places = torch.zeros_like(self._unit), rng.stream("curvature")
        self._updates = updates
        super().__init__(q, sources / self._unit, obs_dim, settings, rng)

    @property
    def mu(self) -> Tensor:
        return self._posterior.mu.detach() * self._unit

    @property
    def scale_tril(self) -> Tensor:
        return self._posterior.scale_tril * self._unit.unsqueeze(-1)

    def learn(self, transition: Transition) -> None:
        """Store one transition of each run and take some gradient steps on eq. 5.2."""
        super().learn(transition)
        for _ in range(self._updates - 1):
            self.update()
        if self._steps >= FIRST and self._steps.bit_count() == 1:
            self._measure()

    def state(self) -> dict[str, Tensor]:
        """All that it takes to go on but random numbers; copies, with runs as leading axis."""
        adam = self._adam.state.get(self._posterior.mu) or {}
        moments = {x: adam[x] for x in MOMENTS if x in adam}
        state = {"means": self._posterior.mu.detach(), "curvature": self._eta, **moments}
        return {
            **{name: x.cpu().clone() for name, x in state.items()},
            "transitions": self._buffer.rows(),
            "steps": torch.full((len(self.mu),), self._steps),
        }

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Go on from a state."""
        with torch.no_grad():
            self._posterior.mu.copy_(state["means"])
        self._steps = int(state["steps"][0])
        self._eta = state["curvature"].to(self._eta)
        self._buffer.fill(state["transitions"])
        moments = {x: state[x].to(self._device) for x in MOMENTS if x in state}
        if moments:
            taken = torch.tensor(float(self._updates * (self._steps - FIRST)))
            self._adam.state[self._posterior.mu] = {"step": taken, **moments}
        self._samples = self._posterior.sample()

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
