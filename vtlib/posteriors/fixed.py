"""Posteriors of which only the means are learned: the deviations stay those of the prior."""

from __future__ import annotations

import torch
from torch import Tensor

from vtlib.posteriors.base import Descent
from vtlib.priors import Precision, Start, too_far_apart
from vtlib.rng import Stream


class Fixed:
    """Gaussians w = mu + sigma z whose deviations sigma are the prior's for ever.

    Cost and memory are linear in d. The start is that of ``Diagonal``. Raises ValueError when
    rounding spoils the deviations.
    """

    def __init__(
        self, start: Start, precision: Precision, descent: Descent, noise: Stream, n_samples: int
    ) -> None:
        self.mu = start.mu
        self._noise, self._n_samples = noise, n_samples
        d = start.mu.shape[2]
        diagonal = precision.diagonal(d).to(start.mu.device)
        # a row for each run, or one for all
        self._sigma = diagonal.double().rsqrt().float().clamp_(min=descent.sigma_min).view(-1, d)
        if start.spread is not None and not self._sigma.isfinite().all():
            raise too_far_apart(start.spread)

    @property
    def deviations(self) -> Tensor:
        """Standard deviations of the weights (R, C, d)."""
        return self._sigma.unsqueeze(1).expand_as(self.mu)

    @property
    def scale_tril(self) -> Tensor:
        """The Cholesky factors L (R, C, d, d), which are diagonal."""
        return torch.diag_embed(self.deviations)

    def sample(self) -> Tensor:
        """Weights w = mu + sigma z (R, C, n_samples, d)."""
        runs, components, d = self.mu.shape
        z = self._noise.normal(components * self._n_samples * d).to(self.mu.device)
        z = z.view(runs, components, self._n_samples, d)
        return (z * self._sigma.view(-1, 1, 1, d)).add_(self.mu.unsqueeze(2))

    def step(self, gradients: Tensor, kl_weight: float) -> None:
        """Leave the deviations as they are."""
