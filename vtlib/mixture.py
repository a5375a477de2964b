"""Mixtures of Gaussians: the variational upper bound on their KL and its fixed point."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from vtlib.gaussian import Gaussian

MAX_UPDATES = 50
TOLERANCE = 1e-6


def responsibilities(pairwise: Tensor, updates: int | None = None) -> tuple[Tensor, Tensor]:
    """log(theta) and log(phi) that tighten the bound of eq. 5.13, by eqs. 5.14 and 5.15.

    pairwise: (..., C, S), the KL of posterior component i from prior component j, both mixtures
    equally weighted. Runs from uniform phi to convergence, or for a given number of updates, in
    logarithms: the KLs reach 1e6 and exp(-KL) would vanish. Both results are float64 of shape
    (..., C, S); theta sums to 1/C over j, phi to 1/S over i. Source: Hershey and Olsen (2007).
    """
    # distances of 1e6 leave float32 no digits for the logarithms' differences
    pairwise = pairwise.double()
    components, sources = pairwise.shape[-2:]
    log_phi = pairwise.new_full(pairwise.shape, -math.log(components * sources))
    log_theta = _theta(log_phi, pairwise)
    moving = torch.ones_like(pairwise[..., :1, :1], dtype=torch.bool)
    # with one component phi is fixed by its constraint, and theta is exact at once
    for _ in range(_count(components, updates)):
        new_phi = log_theta - log_theta.logsumexp(-2, keepdim=True) - math.log(sources)
        new_theta = _theta(new_phi, pairwise)
        # each run stops by itself, so that its numbers do not depend on its neighbours
        log_phi = torch.where(moving, new_phi, log_phi)
        change = (new_theta.exp() - log_theta.exp()).abs().amax((-2, -1), keepdim=True)
        log_theta = torch.where(moving, new_theta, log_theta)
        if updates is None:
            moving = moving & (change >= TOLERANCE)
            if not moving.any():
                break
    return log_theta, log_phi


def _theta(log_phi: Tensor, pairwise: Tensor) -> Tensor:
    return torch.log_softmax(log_phi - pairwise, -1) - math.log(pairwise.shape[-2])


def _count(components: int, updates: int | None) -> int:
    if components == 1:
        return 0
    return MAX_UPDATES if updates is None else updates


def kl_bound(pairwise: Tensor, log_theta: Tensor, log_phi: Tensor) -> Tensor:
    """The upper bound of eq. 5.13 on the KL of two mixtures, shape (...).

    All arguments (..., C, S). It is exact for single Gaussians.
    """
    theta = log_theta.exp()
    # theta = 0 contributes nothing even where phi = 0 makes the logarithms infinite
    terms = theta * (log_theta - log_phi + pairwise)
    return torch.where(theta > 0, terms, 0.0).sum((-2, -1))


def pairwise_kl(q: Gaussian, sources: Tensor, variance: float) -> Tensor:
    """KL (..., C, S) of components q (..., C, d) from N(w_j, variance * I), eq. 5.7.

    sources: (..., S, d).
    """
    d = q.mu.shape[-1]
    log_det = 2 * q.L.diagonal(dim1=-2, dim2=-1).log().sum(-1)
    trace = q.L.square().sum((-2, -1)) / variance
    own = 0.5 * (d * math.log(variance) - log_det + trace - d)
    return own.unsqueeze(-1) + squared_distances(q.mu, sources) / (2 * variance)


def squared_distances(mu: Tensor, sources: Tensor) -> Tensor:
    """Squared distances (..., C, S) of means (..., C, d) from sources (..., S, d)."""
    return _differences(mu, sources).square_().sum(-1)


def _differences(mu: Tensor, sources: Tensor) -> Tensor:
    # expanding the square instead would lose the digits that a variance of 1e-5 needs
    return mu.unsqueeze(-2) - sources.unsqueeze(-3)


def pull_of_sources(mu: Tensor, sources: Tensor, variance: float) -> Tensor:
    """Gradient (..., C, d) of the tightened bound with respect to the means.

    Only the distances matter: what a component's own covariance adds to its KLs is the same for
    every source and cancels from eq. 5.15.
    """
    apart = _differences(mu, sources)
    log_theta, _ = responsibilities((apart * apart).sum(-1) / (2 * variance))
    return (log_theta.exp().to(mu.dtype).unsqueeze(-2) @ apart).squeeze(-2) / variance
