"""Posteriors with a full covariance, plainly: the kernels' reference, and for graphics cards."""

import torch
from torch import Tensor

from vtlib.posteriors.base import Posterior
from vtlib.priors import Start, covariance_factor


class Dense(Posterior):
    """Lower-triangular factors L (M, d, d) of M Gaussians under plain SGD.

    A step descends the expected squared TD error (eq. 5.11) plus kl_weight * KL (eq. 5.9), with the
    gradient clipped elementwise and then diag(L) held at sigma_min or more. Only the lower triangle
    of L is free, and there L^{-T} is the diagonal matrix of 1 / L_ii: nothing is inverted, and as
    the precision is the identity minus few columns, a step costs O(n d^2).
    """

    def _start(self, start: Start) -> None:
        self._L = start_factors(start, self._sigma_min)

    def _factors(self) -> Tensor:
        return self._L

    def _product(self, z: Tensor) -> Tensor:
        return torch.bmm(z, self._L.mT)

    def _descend(self, gradients: Tensor, z: Tensor, kl_weight: float) -> None:
        diagonal = self._L.diagonal(dim1=1, dim2=2)
        if self._kl == "full":
            pull = self._precision.times(self._L)
        else:
            precision = self._precision.diagonal(diagonal.shape[1]).to(diagonal.device)
            pull = torch.diag_embed(precision * diagonal)
        pull.diagonal(dim1=1, dim2=2).sub_(1 / diagonal)
        pull.clamp_(-self._kl_clip, self._kl_clip)
        gradient = torch.baddbmm(pull, gradients.mT, z, beta=kl_weight)
        self._L.sub_(gradient.clamp_(-self._clip, self._clip).tril_(), alpha=self._alpha)
        diagonal.clamp_(min=self._sigma_min)


def start_factors(start: Start, sigma_min: float) -> Tensor:
    """Cholesky factors (M, d, d) of a start's covariance, their diagonals lifted to sigma_min."""
    runs, components, d = start.mu.shape
    if start.spread is None:
        identity: Tensor = torch.eye(d, device=start.mu.device) * start.variance**0.5
        factors = identity.repeat(runs * components, 1, 1)
    else:
        factors = covariance_factor(start.spread, start.variance)
        factors = factors if components == 1 else factors.repeat_interleave(components, 0)
    factors.diagonal(dim1=1, dim2=2).clamp_(min=sigma_min)
    return factors
