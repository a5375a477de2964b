"""Projections of sources, the mass of kernels in cells, and held-out densities."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch.distributions import MultivariateNormal

from vtlib.illustrations.mixture_kl import kernels, log_density
from vtlib.illustrations.source_prior import (
    explained,
    fitted,
    held_out,
    mass,
    nearest,
    principal_directions,
    prior_picture,
)


def sources(count: int = 12, d: int = 6) -> torch.Tensor:
    """Weights that differ by 3, 2 and a little along the first axes."""
    g = torch.Generator().manual_seed(5)
    scale = torch.tensor([3.0, 2.0] + [0.05] * (d - 2), dtype=torch.float64)
    return torch.randn(count, d, generator=g).double() * scale + 1.0


def test_principal_directions_are_the_leading_eigenvectors_of_the_covariance():
    weights = sources()
    directions = principal_directions(weights)
    torch.testing.assert_close(directions.T @ directions, torch.eye(2).double())
    covariance = torch.cov(weights.T, correction=0)
    eigenvalues = torch.linalg.eigvalsh(covariance).flip(0)
    torch.testing.assert_close(covariance @ directions, directions * eigenvalues[:2])
    assert explained(weights, directions) == pytest.approx(
        float(eigenvalues[:2].sum() / eigenvalues.sum())
    )


def test_fitted_gaussian_of_projections_is_the_marginal_of_the_fitted_gaussian():
    weights = sources()
    directions = principal_directions(weights)
    whole, part = fitted(weights), fitted(weights @ directions)
    torch.testing.assert_close(part.mu, whole.mu @ directions)
    torch.testing.assert_close(part.L @ part.L.T, directions.T @ (whole.L @ whole.L.T) @ directions)


@pytest.mark.parametrize("width", [1e-3, 0.3, 2.0])
def test_mass_of_all_cells_is_one(width):
    points = sources()[:, :2]
    edges = torch.linspace(-40, 40, 101, dtype=torch.float64)
    assert float(mass(points, width, edges, edges).sum()) == pytest.approx(1.0)


def test_mass_of_narrow_kernels_is_a_count_of_sources():
    points = torch.tensor([(0.5, 1.5), (0.5, 1.5), (2.5, 0.5)], dtype=torch.float64)
    x, y = torch.arange(4).double(), torch.arange(3).double()
    cells = mass(points, 1e-4, x, y)
    expected = torch.tensor([(0, 0, 1), (2, 0, 0)], dtype=torch.float64) / 3
    torch.testing.assert_close(cells, expected)


def test_mass_is_the_density_times_the_area_of_small_cells():
    points = sources()[:, :2]
    edges = torch.linspace(-1, 1, 201, dtype=torch.float64)
    cells = mass(points, 0.8, edges, edges)
    middle = (edges[1:] + edges[:-1]) / 2
    at = torch.stack(torch.meshgrid(middle, middle, indexing="xy"), -1).flatten(0, 1)
    density = log_density(at, kernels(points, 0.64)).exp().view_as(cells)
    torch.testing.assert_close(cells, density * 1e-4, rtol=1e-3, atol=0)


def test_held_out_density_uses_only_the_others():
    points = torch.tensor([(0.0,), (1.0,), (4.0,)], dtype=torch.float64)
    normal = [[-0.5 * (a - b) ** 2 for b in (0, 1, 4) if b != a] for a in (0, 1, 4)]
    expected = [
        math.log(sum(map(math.exp, logs)) / 2) - 0.5 * math.log(2 * math.pi) for logs in normal
    ]
    assert held_out(points, 1.0) == pytest.approx(np.mean(expected))


def test_held_out_density_of_the_gaussian():
    weights = sources(5, 3)
    expected = []
    for k in range(5):
        rest = torch.cat([weights[:k], weights[k + 1 :]])
        covariance = torch.cov(rest.T, correction=0) + 1e-4 * torch.eye(3).double()
        expected.append(float(MultivariateNormal(rest.mean(0), covariance).log_prob(weights[k])))
    assert held_out(weights, None) == pytest.approx(np.mean(expected))


def test_nearest_other_source():
    points = torch.tensor([(0.0, 0.0), (3.0, 4.0), (3.0, 5.0)], dtype=torch.float64)
    assert nearest(points).tolist() == [5.0, 1.0, 1.0]


def test_picture_tells_width_and_densities():
    weights = sources()
    html = prior_picture(weights, 0.3)
    points = (weights - weights.mean(0)) @ principal_directions(weights)
    assert "kernels of width 0.3 on 12 sources" in html
    assert f"{held_out(points, 0.3):.2f} against {held_out(points, None):.2f}" in html
