"""The Cholesky factors of a batch of posteriors, updated by gradient steps of O(n d^2) each."""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor

from vtlib.gaussian import Precision

PANELS = 4  # row panels: work above the diagonal is skipped but for the panels' own triangles


class CholeskyFactors:
    """Lower-triangular factors L (M, d, d) of M Gaussians under plain SGD.

    One step descends the expected squared TD error (eq. 5.11) plus kl_weight * KL (eq. 5.9), with
    the gradient clipped elementwise to +-clip and then diag(L) held at sigma_min or more. The given
    L is not changed. The TD part is a sum of n outer products and the precision is a multiple of
    the identity minus few columns, so a step needs neither an inverse nor a product of two d x d
    matrices. ``ahead`` tells how many draws ``look_ahead`` takes.
    """

    ahead = 1

    def __init__(
        self, L: Tensor, precision: Precision, alpha: float, sigma_min: float, clip: float
    ) -> None:
        self.L = L.clone()
        self.L.diagonal(dim1=-2, dim2=-1).clamp_(min=sigma_min)
        self._precision = precision
        self._alpha, self._sigma_min, self._clip = alpha, sigma_min, clip
        d = L.shape[-1]
        edges = torch.linspace(0, d, min(PANELS, d) + 1).long().tolist()
        self._panels = list(pairwise(edges))
        self._largest = self._largest_entry()

    def look_ahead(self, noise: Tensor) -> None:
        """Make ready for ``product`` with noise (1, M, k, d)."""
        self._noise = noise

    def product(self, at: int) -> Tensor:
        """L z (M, k, d) with the present L, for the draw ``at`` of the last ``look_ahead``."""
        noise = self._noise[at]
        parts = [
            torch.bmm(noise[:, :, :end], self.L[:, start:end, :end].transpose(1, 2))
            for start, end in self._panels
        ]
        return torch.cat(parts, -1)

    def step(self, gradients: Tensor, noise: Tensor, kl_weight: float) -> None:
        """One SGD step; the TD part of the gradient is sum_k gradients_k noise_k^T, (M, n, d)."""
        if self._may_clip(gradients, noise, kl_weight):
            self._clipped_step(gradients, noise, kl_weight)
        else:
            self._low_rank_step(gradients, noise, kl_weight)

    def _low_rank_step(self, gradients: Tensor, noise: Tensor, kl_weight: float) -> None:
        scale, W = self._precision
        pull = self._alpha * kl_weight
        left, right = gradients.mul(-self._alpha), noise
        if W is not None:
            left = torch.cat([left, W.transpose(1, 2) * (pull * scale)], 1)
            right = torch.cat([right, self._transposed_times(W)], 1)
        diagonal = self.L.diagonal(dim1=-2, dim2=-1)
        push = pull / diagonal
        left = left.transpose(1, 2)
        for start, end in self._panels:
            panel = self.L[:, start:end, :end]
            panel.baddbmm_(left[:, start:end], right[:, :, :end], beta=1 - pull * scale)
            panel[:, :, start:].tril_()
        diagonal.add_(push).clamp_(min=self._sigma_min)

    def _transposed_times(self, W: Tensor) -> Tensor:
        """W^T L, (M, r, d)."""
        out = torch.zeros(W.shape[0], W.shape[2], W.shape[1], device=W.device)
        for start, end in self._panels:
            out[:, :, :end].baddbmm_(W[:, start:end].transpose(1, 2), self.L[:, start:end, :end])
        return out

    def _clipped_step(self, gradients: Tensor, noise: Tensor, kl_weight: float) -> None:
        """The same step with the gradient written out, for the rare case that clipping binds."""
        gradient = torch.bmm(gradients.transpose(1, 2), noise)
        gradient.add_(self._precision.times(self.L), alpha=kl_weight)
        diagonal = self.L.diagonal(dim1=-2, dim2=-1)
        gradient.diagonal(dim1=-2, dim2=-1).sub_(kl_weight / diagonal)
        self.L.sub_(gradient.clamp_(-self._clip, self._clip).tril_(), alpha=self._alpha)
        diagonal.clamp_(min=self._sigma_min)
        self._largest = self._largest_entry()

    def _may_clip(self, gradients: Tensor, noise: Tensor, kl_weight: float) -> bool:
        """Whether an entry of the gradient could exceed the clip, by bounds that cost O(n d)."""
        reach = gradients.abs().amax(-1).mul_(noise.abs().amax(-1)).sum(-1)
        td = float(reach.max())
        pull = kl_weight * self._precision.scale * self._column_norm()
        if td + pull * self._largest + kl_weight / self._sigma_min <= self._clip:
            # an upper bound on the entries from here on, without reading L
            growth = self._alpha * (td + kl_weight / self._sigma_min)
            self._largest = self._largest * (1 + self._alpha * pull) + growth
            return False
        self._largest = self._largest_entry()
        return not td + pull * self._largest + kl_weight / self._sigma_min <= self._clip

    def _column_norm(self) -> float:
        return 1.0 if self._precision.W is None else self.L.shape[-1] ** 0.5

    def _largest_entry(self) -> float:
        return float(self.L.abs().max())
