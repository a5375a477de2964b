"""What posteriors share: weights w = mu + L z, and steps of gradient descent on L."""

import math
from abc import ABC, abstractmethod
from typing import NamedTuple

from torch import Tensor

from vtlib.priors import Precision, Start
from vtlib.rng import Stream


class Descent(NamedTuple):
    """How L descends: alpha_L, sigma_min, clip, kl and kl_clip of ``vtlib.transfer.Settings``."""

    alpha: float
    sigma_min: float
    clip: float | None = None
    kl: str = "full"
    kl_clip: float | None = None


class Posterior(ABC):
    """C Gaussians for each of R runs, which sample w = mu + L z (eq. 5.10).

    mu (R, C, d) are their means, which the engine moves; L are M = R C lower-triangular factors.
    It begins at a start, pulled by the prior's precision; n_samples are drawn at a time.
    """

    def __init__(
        self, start: Start, precision: Precision, descent: Descent, noise: Stream, n_samples: int
    ) -> None:
        self.mu = start.mu
        self._precision, self._kl = precision, descent.kl
        self._alpha, self._sigma_min = descent.alpha, descent.sigma_min
        self._clip, self._kl_clip = (
            math.inf if bound is None else bound for bound in (descent.clip, descent.kl_clip)
        )
        self._noise, self._n_samples = noise, n_samples
        self._start(start)

    @property
    def scale_tril(self) -> Tensor:
        """The Cholesky factors L (R, C, d, d), which may be a copy."""
        factors: Tensor = self._factors().unflatten(0, self.mu.shape[:2])
        return factors

    def sample(self) -> Tensor:
        """Weights w = mu + L z (R, C, n_samples, d)."""
        runs, components, d = self.mu.shape
        z = self._draw(components * self._n_samples * d).to(self.mu.device)
        self._z = z.reshape(runs * components, self._n_samples, d)
        samples = self._product(self._z).view(runs, components, self._n_samples, d)
        samples += self.mu.unsqueeze(2)
        return samples

    def step(self, gradients: Tensor, kl_weight: float) -> None:
        """One step of L on the TD error plus kl_weight times the divergence.

        gradients: (R, C, n, d), of the TD error at the last n weights sampled, each divided by n.
        """
        count = gradients.shape[2]
        self._descend(gradients.flatten(0, 1), self._z[:, -count:], kl_weight)

    def _draw(self, n: int) -> Tensor:
        """The noise (R, n) of the next samples."""
        return self._noise.normal(n)

    @abstractmethod
    def _start(self, start: Start) -> None:
        """Take over the covariance of a start."""

    @abstractmethod
    def _factors(self) -> Tensor:
        """The factors (M, d, d)."""

    @abstractmethod
    def _product(self, z: Tensor) -> Tensor:
        """L z (M, k, d) with the present L."""

    @abstractmethod
    def _descend(self, gradients: Tensor, z: Tensor, kl_weight: float) -> None:
        """One step; the TD part of the gradient is sum_k gradients_k z_k^T, (M, n, d) each."""
