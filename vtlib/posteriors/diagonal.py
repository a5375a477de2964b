"""Posteriors without correlations: standard deviations in place of Cholesky factors."""

import torch
from torch import Tensor

from vtlib.posteriors.base import Posterior
from vtlib.priors import Start, too_far_apart


class Diagonal(Posterior):
    """Diagonals sigma (M, d) of diagonal factors L under plain SGD, as `Dense`.

    Cost and memory are linear in d. Eqs. 5.9 and 5.11 restricted to the diagonal. The start is the
    minimiser of the KL among such Gaussians: the variances are those of the prior's precision.
    Raises ValueError when rounding spoils them.
    """

    def _start(self, start: Start) -> None:
        runs, components, d = start.mu.shape
        pull = self._precision.diagonal(d).to(self.mu.device)
        self._pull = pull.expand(runs, d).repeat_interleave(components, 0)
        self._sigma = self._pull.double().rsqrt().float().clamp_(min=self._sigma_min)
        if start.spread is not None and not self._sigma.isfinite().all():
            raise too_far_apart(start.spread)

    def _factors(self) -> Tensor:
        return torch.diag_embed(self._sigma)

    def _product(self, z: Tensor) -> Tensor:
        return z * self._sigma.unsqueeze(1)

    def _descend(self, gradients: Tensor, z: Tensor, kl_weight: float) -> None:
        pull = (self._pull * self._sigma - 1 / self._sigma).clamp_(-self._kl_clip, self._kl_clip)
        gradient = (gradients * z).sum(1).add_(pull, alpha=kl_weight)
        self._sigma -= self._alpha * gradient.clamp_(-self._clip, self._clip)
        self._sigma.clamp_(min=self._sigma_min)


class Fixed(Diagonal):
    """Gaussians of which only the means are learned: deviations stay the prior's for ever."""

    def step(self, gradients: Tensor, kl_weight: float) -> None:
        """Leave the deviations as they are."""
