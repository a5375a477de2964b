"""Multivariate Gaussians N(mu, L L^T) over Q-function weights: estimation, KL and its gradients."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

DOUBLES = 2**22  # numbers of double precision in the matrices that are factored at once


class Gaussian(NamedTuple):
    """A Gaussian by its mean mu (..., d) and lower-triangular Cholesky factor L (..., d, d)."""

    mu: Tensor
    L: Tensor


class Precision(NamedTuple):
    """A precision matrix scale * (I - W W^T), with W (..., d, r) of few columns, or None."""

    scale: float
    W: Tensor | None = None

    def times(self, x: Tensor) -> Tensor:
        """The product with the columns of x (..., d, k)."""
        if self.W is None:
            return self.scale * x
        return self.scale * (x - self.W @ (self.W.transpose(-1, -2) @ x))

    def diagonal(self, d: int) -> Tensor:
        """The diagonal, (..., d)."""
        if self.W is None:
            return torch.full((d,), self.scale)
        return self.scale * (1 - self.W.square().sum(-1))


def sources_mean_and_spread(sources: Tensor) -> tuple[Tensor, Tensor]:
    """Mean mu_p (..., d) of eq. 5.5, and B (..., d, S) with B B^T the covariance of eq. 5.6.

    sources: (..., S, d) weights of S source tasks.
    """
    mu = sources.mean(-2)
    spread = (sources - mu.unsqueeze(-2)).transpose(-1, -2) / sources.shape[-2] ** 0.5
    return mu, spread


def covariance_factor(spread: Tensor, jitter: float) -> Tensor:
    """Cholesky factor (..., d, d) of B B^T + jitter * I, from B (..., d, S)."""
    *batch, d, count = spread.shape
    factors = spread.new_empty(*batch, d, d)
    # a few at a time: all of them in double precision would take several times the memory. An even
    # number, for the last digit depends on where in 16 bytes a matrix begins
    few = 2 * max(1, DOUBLES // d**2 // 2)
    parts = factors.view(-1, d, d).split(few)
    for some, part in zip(spread.reshape(-1, d, count).split(few), parts, strict=True):
        wide = some.double()
        covariance = wide @ wide.mT
        covariance.diagonal(dim1=-2, dim2=-1).add_(jitter)
        part.copy_(torch.linalg.cholesky(covariance, out=covariance))
    return factors


def low_rank_precision(spread: Tensor, jitter: float) -> Precision:
    """Inverse of B B^T + jitter * I from B (..., d, S), never as a d x d matrix."""
    left, singular, _ = torch.linalg.svd(spread.double(), full_matrices=False)
    shrink = (singular**2 / (singular**2 + jitter)).sqrt()
    return Precision(1 / jitter, (left * shrink.unsqueeze(-2)).to(spread.dtype))


def kl(q: Gaussian, p: Gaussian) -> Tensor:
    """KL(q || p) of two Gaussians, eq. 5.7; batch axes broadcast, returns (...)."""
    whitened = torch.linalg.solve_triangular(p.L, q.L, upper=False)
    shift = torch.linalg.solve_triangular(p.L, (q.mu - p.mu).unsqueeze(-1), upper=False)
    log_volumes = _log_diagonal(p.L) - _log_diagonal(q.L)
    squares: Tensor = whitened.square().sum((-2, -1)) + shift.square().sum((-2, -1))
    return log_volumes + 0.5 * (squares - q.mu.shape[-1])


def kl_gradients(q: Gaussian, mu_p: Tensor, precision: Precision) -> tuple[Tensor, Tensor]:
    """Gradients of KL(q || p) with respect to mu (eq. 5.8) and L (eq. 5.9).

    Only the lower triangle of L is free, and there L^{-T} is the diagonal matrix of 1 / L_ii.
    Shapes (..., d) and (..., d, d).
    """
    toward_prior = precision.times((q.mu - mu_p).unsqueeze(-1)).squeeze(-1)
    inverse_diagonal = torch.diag_embed(1 / q.L.diagonal(dim1=-2, dim2=-1))
    return toward_prior, (precision.times(q.L) - inverse_diagonal).tril()


def _log_diagonal(factor: Tensor) -> Tensor:
    """Half the log-determinant of L L^T."""
    return factor.diagonal(dim1=-2, dim2=-1).log().sum(-1)
