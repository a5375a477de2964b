"""Two priors made of the same sources: one Gaussian, and one kernel on each source."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.distributions import MultivariateNormal

from vtlib.priors import (
    PRIOR_JITTER,
    Gaussian,
    covariance_factor,
    sources_mean_and_spread,
)


def principal_directions(weights: Tensor) -> Tensor:
    """The two orthonormal directions (d, 2) in which weights (S, d) differ most."""
    right: Tensor = torch.linalg.svd(weights - weights.mean(0), full_matrices=False).Vh
    return right[:2].T


def fitted(weights: Tensor) -> Gaussian:
    """The Gaussian (d,), (d, d) of eqs. 5.5 and 5.6 with GVT's jitter, from weights (S, d).

    Of projections on orthonormal directions it is the marginal of the Gaussian in all of them.
    """
    mu, spread = sources_mean_and_spread(weights)
    return Gaussian(mu, covariance_factor(spread, PRIOR_JITTER))


def mass(points: Tensor, width: float, x: Tensor, y: Tensor) -> Tensor:
    """Mass (ny - 1, nx - 1) of the prior of section 5.2.2 in each cell between edges x and y.

    points: (S, 2) sources; exact, however narrow the kernels are.
    """
    across, up = (
        torch.special.ndtr((edges - points[:, axis, None]) / width).diff(dim=1)
        for axis, edges in enumerate((x, y))
    )
    share: Tensor = up.T @ across / len(points)
    return share


def held_out_kernels(points: Tensor, width: float) -> float:
    """Mean log density of each source (S, d) under kernels of width sigma_p on the others."""
    count, d = points.shape
    apart = (points.unsqueeze(1) - points).square().sum(-1).fill_diagonal_(torch.inf)
    logs = torch.logsumexp(-apart / (2 * width**2), 1) - math.log(count - 1)
    return float(logs.mean()) - d / 2 * math.log(2 * math.pi * width**2)


def held_out_gaussian(points: Tensor) -> float:
    """Mean log density of each source (S, d) under the Gaussian fitted to the others."""
    rest = [torch.cat([points[:k], points[k + 1 :]]) for k in range(len(points))]
    priors = [MultivariateNormal(mu, scale_tril=L) for mu, L in map(fitted, rest)]
    return float(torch.stack([p.log_prob(w) for p, w in zip(priors, points, strict=True)]).mean())
