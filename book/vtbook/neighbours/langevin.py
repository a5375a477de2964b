"""Langevin dynamics on the objective's own posterior: no family, one noisy gradient chain."""

from __future__ import annotations

import torch
from attrs import field, frozen
from torch import Tensor

from vtbook.neighbours.base import Learner, TDSettings
from vtlib.checks import HUGE, between, one_of, positive
from vtlib.priors import PRIOR_JITTER, GaussianPrior, MixturePrior
from vtlib.qfunctions import QFunction
from vtlib.replay import Transition
from vtlib.rng import Rng

BETA1, BETA2, SMALL = 0.9, 0.999, 1e-8  # of Adam's moments, as its authors chose them


@frozen(kw_only=True)
class LangevinSettings(TDSettings):
    """Parameters of Langevin Monte Carlo with Adam's drift (Ishfaq et al. 2024).

    lambda_: weight of the prior as in eq. 5.2, which is also the temperature. alpha: step size.
    bias: weight of Adam's direction beside the plain gradient. prior: "gaussian" or "mixture", as
    for the two posteriors, with their jitter or variance sigma_p2. Raises ValueError for a value
    outside its range.
    """

    lambda_: float = field(default=1e-6, validator=between(0, HUGE))
    alpha: float = field(default=1e-3, validator=positive())
    bias: float = field(default=1.0, validator=between(0, HUGE))
    prior: str = field(default="mixture", validator=one_of(("gaussian", "mixture")))
    jitter: float = field(default=PRIOR_JITTER, validator=positive())
    sigma_p2: float = field(default=1e-5, validator=positive())

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> Langevin:
        """An agent that transfers from sources (R, S, d)."""
        return Langevin(q, sources.cpu(), obs_dim, self, rng)


class Langevin(Learner):
    """A chain whose law tends to exp(-(N / lambda) E[TD error^2]) p(w), which eq. 5.2 approximates.

    A step is w - alpha (g + bias m / sqrt(v + small)) + sqrt(2 alpha lambda / N) xi, with g the
    gradient of the objective at w, prior included, m and v Adam's moments of g, and xi standard
    normal. The agent acts greedily by the chain's present weights, which start at the sources'
    mean. Source: Ishfaq et al. (2024), algorithm 2.
    """

    def __init__(
        self, q: QFunction, sources: Tensor, obs_dim: int, settings: LangevinSettings, rng: Rng
    ) -> None:
        super().__init__(q, sources, obs_dim, settings, rng)
        s = settings
        self._prior = (
            GaussianPrior(sources, s.jitter)
            if s.prior == "gaussian"
            else MixturePrior(sources, s.sigma_p2)
        )
        self._settings, self._noise = s, rng.stream("posterior")
        self.mu = sources.mean(1, keepdim=True)
        self._m, self._v = torch.zeros_like(self.mu), torch.zeros_like(self.mu)

    def _acting(self, fresh: Tensor) -> Tensor:
        return self.mu

    def _descend(self, batch: Transition) -> None:
        s, temperature = self._settings, self._settings.lambda_ / self._steps
        g = self._gradients(self.mu, batch).add_(self._prior.pull(self.mu), alpha=temperature)
        self._m.lerp_(g, 1 - BETA1)
        self._v.mul_(BETA2).addcmul_(g, g, value=1 - BETA2)
        noise = self._noise.normal(self.mu.shape[-1]).unsqueeze(1)
        drift = g.addcdiv_(self._m, (self._v + SMALL).sqrt_(), value=s.bias)
        self.mu = self.mu - s.alpha * drift + (2 * s.alpha * temperature) ** 0.5 * noise
