"""Posteriors without correlations: standard deviations in place of Cholesky factors."""

from __future__ import annotations

import torch
from torch import Tensor

from vtlib.gaussian import Precision


class DiagonalFactors:
    """Diagonals sigma (M, d) of diagonal factors L under plain SGD, as `CholeskyFactors`.

    Cost and memory are linear in d. Eqs. 5.9 and 5.11 restricted to the diagonal; the off-diagonal
    entries of the given L (M, d, d) are ignored.
    """

    ahead = 1

    def __init__(
        self, L: Tensor, precision: Precision, alpha: float, sigma_min: float, clip: float
    ) -> None:
        self._sigma = L.diagonal(dim1=-2, dim2=-1).clamp(min=sigma_min)
        self._pull = precision.diagonal(L.shape[-1]).to(L.device)
        self._alpha, self._sigma_min, self._clip = alpha, sigma_min, clip

    @property
    def L(self) -> Tensor:
        """The factors written out, (M, d, d)."""
        return torch.diag_embed(self._sigma)

    def look_ahead(self, noise: Tensor) -> None:
        """Make ready for ``product`` with noise (1, M, k, d)."""
        self._noise = noise

    def product(self, at: int) -> Tensor:
        """L z (M, k, d) with the present L, for the draw ``at`` of the last ``look_ahead``."""
        return self._noise[at] * self._sigma.unsqueeze(1)

    def step(self, gradients: Tensor, noise: Tensor, kl_weight: float) -> None:
        """One SGD step; the TD part of the gradient is sum_k gradients_k noise_k^T, (M, n, d)."""
        gradient = (gradients * noise).sum(1)
        gradient += kl_weight * (self._pull * self._sigma - 1 / self._sigma)
        self._sigma -= self._alpha * gradient.clamp_(-self._clip, self._clip)
        self._sigma.clamp_(min=self._sigma_min)
