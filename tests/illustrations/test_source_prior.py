"""Projections of sources, the mass of kernels in cells, and held-out densities."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.distributions import MultivariateNormal

from vtlib.illustrations import source_prior

EYE = torch.eye(6, dtype=torch.float64)


@pytest.fixture
def weights() -> Tensor:
    """Twelve that differ by 3, 2 and a little along the first of six axes."""
    scale = torch.tensor([3.0, 2.0] + [0.05] * 4, dtype=torch.float64)
    return torch.randn(12, 6, generator=torch.Generator().manual_seed(5)).double() * scale + 1.0


def test_the_gaussian_of_projections_on_leading_eigenvectors_is_a_marginal(weights: Tensor):
    directions = source_prior.principal_directions(weights)
    covariance = torch.cov(weights.T, correction=0)
    eigenvalues = torch.linalg.eigvalsh(covariance).flip(0)[:2]
    torch.testing.assert_close(covariance @ directions, directions * eigenvalues)
    part = source_prior.fitted(weights @ directions).scale_tril
    torch.testing.assert_close(part @ part.T, torch.diag(eigenvalues + 1e-4))


def test_mass_is_the_density_times_the_area_of_small_cells(weights: Tensor):
    x, y = (torch.linspace(-1, end, 201, dtype=torch.float64) for end in (1, 2))
    middles = [(edges[1:] + edges[:-1]) / 2 for edges in (x, y)]
    at = torch.stack(torch.meshgrid(*middles, indexing="xy"), -1)
    kernels = [MultivariateNormal(w, 0.64 * EYE[:2, :2]) for w in weights[:, :2]]
    density = torch.stack([kernel.log_prob(at).exp() for kernel in kernels]).mean(0)
    cells = source_prior.mass(weights[:, :2], 0.8, x, y)
    torch.testing.assert_close(cells, density * 0.01 * 0.015, rtol=1e-3, atol=0)


def test_held_out_densities_use_only_the_others(weights: Tensor):
    under_kernels, under_gaussian = [], []
    for k, w in enumerate(weights):
        rest = torch.cat([weights[:k], weights[k + 1 :]])
        each = torch.stack([MultivariateNormal(other, 0.49 * EYE).log_prob(w) for other in rest])
        under_kernels.append(float(each.exp().mean().log()))
        covariance = torch.cov(rest.T, correction=0) + 1e-4 * EYE
        under_gaussian.append(float(MultivariateNormal(rest.mean(0), covariance).log_prob(w)))
    assert source_prior.held_out_kernels(weights, 0.7) == pytest.approx(sum(under_kernels) / 12)
    assert source_prior.held_out_gaussian(weights) == pytest.approx(sum(under_gaussian) / 12)
