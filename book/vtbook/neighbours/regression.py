"""Exact Bayesian regression in place of variational inference: RLSVI, and networks' last layers."""

from __future__ import annotations

import torch
from attrs import field, frozen
from torch import Tensor

from vtbook.neighbours.base import Learner, TDSettings
from vtbook.neighbours.last_layer import LastLayer
from vtlib.checks import between, positive, whole
from vtlib.priors import PRIOR_JITTER, GaussianPrior
from vtlib.qfunctions import MLP, RBFLinear
from vtlib.replay import Transition
from vtlib.rng import Rng


@frozen(kw_only=True)
class RegressionSettings(TDSettings):
    """Parameters of randomised least-squares value iteration (Osband, Van Roy and Wen 2016).

    noise: standard deviation of a target around the linear function. every: iterations from one
    regression to the next. recent: transitions that it takes in, the last. jitter: added to the
    sources' covariance. alpha: Adam's step size for the weights below the last layer. Raises
    ValueError for a value outside its range.
    """

    noise: float = field(default=0.1, validator=positive())
    every: int = field(default=20, validator=whole())
    recent: int = field(default=5_000, validator=whole())
    jitter: float = field(default=PRIOR_JITTER, validator=positive())
    alpha: float = field(default=1e-3, validator=between(0, 1))

    def agent(self, q: MLP | RBFLinear, sources: Tensor, obs_dim: int, rng: Rng) -> Regression:
        """An agent that transfers from sources (R, S, d)."""
        return Regression(q, sources.cpu(), obs_dim, self, rng)


class Regression(Learner):
    """The last layer's weights by exact Bayesian linear regression on targets of the last sample.

    The prior is the Gaussian of the sources (eqs. 5.5 and 5.6). Every so many iterations the
    targets r + gamma max_a Q(s', a) of the present sample are regressed on features, a new sample
    is drawn from N(A^-1 b, A^-1), A = Sigma_p^-1 + Phi^T Phi / noise^2, and followed greedily. The
    weights below the last layer, where there are any, start at the sources' mean and follow the
    gradient of eq. 5.4. Sources: Osband et al. (2016), algorithm 2; for networks Azizzadenesheli,
    Brunskill and Anandkumar (2018).
    """

    def __init__(
        self,
        q: MLP | RBFLinear,
        sources: Tensor,
        obs_dim: int,
        settings: RegressionSettings,
        rng: Rng,
    ) -> None:
        super().__init__(q, sources, obs_dim, settings, rng)
        self._settings, self._noise = settings, rng.stream("posterior")
        self._layer = LastLayer(q)
        self._last = self._layer.last.flatten()
        prior = GaussianPrior(sources[..., self._last], settings.jitter)
        identity = torch.eye(len(self._last)).expand(len(sources), -1, -1)
        self._precision = prior.precision.times(identity).double()
        self._pull = (self._precision @ prior.mu.mT.double()).squeeze(-1)
        self.mu = sources.mean(1, keepdim=True)
        self._adam = torch.optim.Adam([self.mu], lr=settings.alpha, fused=True)
        self._draw(self._precision, self._pull)

    def _acting(self, fresh: Tensor) -> Tensor:
        self._sample = self.mu.clone()
        self._sample[:, 0, self._last] = self._drawn
        return self._sample

    def _descend(self, batch: Transition) -> None:
        if len(self._last) < self._q.d:
            gradient = self._gradients(self.mu, batch)
            gradient[..., self._last] = 0
            self.mu.grad = gradient
            self._adam.step()
        if self._steps % self._settings.every == 0:
            self._draw(*self.posterior())

    def posterior(self) -> tuple[Tensor, Tensor]:
        """A (R, p, p) and b (R, p), in doubles, of the last weights' posterior N(A^-1 b, A^-1)."""
        s, q = self._settings, self._q
        size = len(self._buffer)
        last = torch.arange(self._steps - min(s.recent, size), self._steps) % s.buffer
        batch = self._buffer.sample(((last + 0.5) / size).expand(len(self.mu), -1))
        phi = self._layer.features(self.mu, q.prepare(batch.obs))
        following = q.q(self._sample, q.prepare(batch.next_obs))[:, 0].amax(1)
        target = batch.reward + s.gamma * following * ~batch.terminated
        A, b, m = self._precision.clone(), self._pull.clone(), phi.shape[1]
        for action in range(q.n_actions):
            at = slice(action * m, (action + 1) * m)
            # A sum of 5,000 squares / noise^2 in floats need not be positive definite.
            inputs = phi.double() * (batch.action == action).unsqueeze(1) / s.noise
            A[:, at, at] += inputs @ inputs.mT
            b[:, at] += (inputs @ target.double().unsqueeze(-1)).squeeze(-1) / s.noise
        return A, b

    def _draw(self, A: Tensor, b: Tensor) -> None:
        """Take the posterior's mean into mu, and a sample from it to act with."""
        factor = torch.linalg.cholesky(A)
        mean = torch.cholesky_solve(b.unsqueeze(-1), factor)
        z = self._noise.normal(b.shape[1]).double().unsqueeze(-1)
        sample = mean + torch.linalg.solve_triangular(factor.mT, z, upper=True)
        self.mu[:, 0, self._last] = mean.squeeze(-1).float()
        self._drawn = sample.squeeze(-1).float()
