"""IVON: a natural-gradient step on a diagonal posterior around the sources."""

from __future__ import annotations

import torch
from attrs import field, frozen
from torch import Tensor

from vtbook.neighbours.base import Learner, TDSettings
from vtlib.checks import between, positive, whole
from vtlib.priors import PRIOR_JITTER
from vtlib.qfunctions import QFunction
from vtlib.replay import Transition
from vtlib.rng import Rng


@frozen(kw_only=True)
class IVONSettings(TDSettings):
    """Parameters of IVON (Shen et al. 2024).

    lambda_: weight of the KL (eq. 5.2). alpha: step size of the means. n_samples: posterior samples
    per gradient. beta1, beta2: decay of the gradient's and of the curvature's averages. h0: the
    curvature at first. clip: bound on an entry of the preconditioned gradient. jitter: added to the
    sources' variances. Raises ValueError for a value outside its range.
    """

    lambda_: float = field(default=1e-6, validator=positive())
    alpha: float = field(default=1e-3, validator=positive())
    n_samples: int = field(default=5, validator=whole())
    beta1: float = field(default=0.9, validator=between(0, 1, below=True))
    beta2: float = field(default=0.999, validator=between(0, 1, below=True))
    h0: float = field(default=1e-3, validator=positive())
    clip: float = field(default=1.0, validator=positive())
    jitter: float = field(default=PRIOR_JITTER, validator=positive())

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> IVON:
        """An agent that transfers from sources (R, S, d)."""
        return IVON(q, sources.cpu(), obs_dim, self, rng)


class IVON(Learner):
    """Means mu and curvatures h of a diagonal Gaussian posterior, which acts by Thompson sampling.

    The prior is N(mu_p, diag(s^2)): the sources' mean and variances. After N steps the posterior's
    variances are lambda / (N (h + delta)) with delta = lambda / (N s^2). From gradients g at
    samples, h moves towards their (g (w - mu)) / sigma^2, which estimates the curvature, by IVON's
    step, that cannot make it negative; mu moves by the averaged gradient plus
    delta (mu - mu_p), divided by h + delta: weights decay to the sources' mean, not to zero.
    Source: Shen et al. (2024), algorithm 1; its ess is N / lambda.
    """

    def __init__(
        self, q: QFunction, sources: Tensor, obs_dim: int, settings: IVONSettings, rng: Rng
    ) -> None:
        super().__init__(q, sources, obs_dim, settings, rng)
        self._settings, self._noise = settings, rng.stream("posterior")
        self._center = sources.mean(1, keepdim=True)
        self._variance = sources.var(1, correction=0, keepdim=True) + settings.jitter
        self.mu = self._center.clone()
        self._h = torch.full_like(self.mu, settings.h0)
        self._g = torch.zeros_like(self.mu)
        self._draw()

    @property
    def variance(self) -> Tensor:
        """The posterior's variances (R, 1, d)."""
        lambda_, count = self._settings.lambda_, max(1, self._steps)
        return lambda_ / (count * self._h + lambda_ / self._variance)

    def _draw(self) -> None:
        """Weights (R, 1 + n_samples, d): those to act with, and those for the next gradient."""
        runs, _, d = self.mu.shape
        count = self._settings.n_samples + 1
        self._z = self._noise.normal(count * d).view(runs, count, d)
        self._sigma = self.variance.sqrt()
        self._samples = self.mu + self._sigma * self._z

    def _acting(self, fresh: Tensor) -> Tensor:
        return self._samples[:, :1]

    def _descend(self, batch: Transition) -> None:
        s = self._settings
        gradients = self._gradients(self._samples[:, 1:], batch)
        curvature = (gradients * self._z[:, 1:] / self._sigma).mean(1, keepdim=True)
        delta = s.lambda_ / (self._steps * self._variance)
        moved, rest = curvature - self._h, 1 - s.beta2
        self._h = self._h + rest * moved + 0.5 * (rest * moved).square() / (self._h + delta)
        self._h.clamp_(min=0)
        self._g = s.beta1 * self._g + (1 - s.beta1) * gradients.mean(1, keepdim=True)
        slope = self._g / (1 - s.beta1**self._steps) + delta * (self.mu - self._center)
        self.mu = self.mu - s.alpha * (slope / (self._h + delta)).clamp_(-s.clip, s.clip)
        self._draw()
