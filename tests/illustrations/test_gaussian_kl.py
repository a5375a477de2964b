"""The parts of the KL of two Gaussians, the pull of its gradient, and the drawn ellipses."""

from __future__ import annotations

import pytest
import torch
from torch.distributions import MultivariateNormal, kl_divergence

from vtlib.gaussian import Gaussian, kl
from vtlib.illustrations.gaussian_kl import ellipse, kl_parts, kl_picture, planar, pull

P = planar(0.0, 0.6, 1.0)
CASES = [planar(s, c, k) for s in (0.0, 1.5) for c in (-0.8, 0.3, 0.9) for k in (0.5, 1.3)]


def test_planar_has_the_stated_moments():
    q = planar(2.0, -0.4, 0.7)
    assert q.mu.tolist() == [2.0, 0.0]
    covariance = 0.49 * torch.tensor([(1.0, -0.4), (-0.4, 1.0)], dtype=torch.float64)
    torch.testing.assert_close(q.L @ q.L.T, covariance)


@pytest.mark.parametrize("q", CASES)
def test_parts_are_the_terms_of_equation_5_7(q):
    covariance, prior = q.L @ q.L.T, P.L @ P.L.T
    parts = kl_parts(q, P)
    assert float(parts.volume) == pytest.approx(
        0.5 * float(torch.logdet(prior) - torch.logdet(covariance))
    )
    assert float(parts.spread) == pytest.approx(
        0.5 * (float(torch.trace(torch.linalg.solve(prior, covariance))) - 2)
    )
    apart = q.mu - P.mu
    assert float(parts.shift) == pytest.approx(
        0.5 * float(apart @ torch.linalg.solve(prior, apart))
    )
    theirs = kl_divergence(*(MultivariateNormal(g.mu, scale_tril=g.L) for g in (q, P)))
    assert float(sum(parts)) == pytest.approx(float(theirs))


@pytest.mark.parametrize("q", CASES)
def test_pull_is_minus_the_slope_of_the_kl(q):
    slope = torch.func.grad(lambda mu: kl(Gaussian(mu, q.L), P))(q.mu)
    torch.testing.assert_close(pull(q, P), -slope)


def test_pull_does_not_point_at_the_mean_of_a_correlated_prior():
    q = planar(1.0, 0.0, 0.7)
    along, across = pull(q, P).tolist()
    assert along < 0 < across


@pytest.mark.parametrize("radius", [1.0, 2.0])
def test_ellipse_lies_at_its_mahalanobis_distance_and_closes(radius):
    q = planar(1.0, 0.8, 0.7)
    points = ellipse(q, radius)
    distance = torch.linalg.solve(q.L, (points - q.mu).T).norm(dim=0)
    torch.testing.assert_close(distance, torch.full_like(distance, radius))
    torch.testing.assert_close(points[0], points[-1])


def test_picture_tells_the_kl():
    q = planar(2.0, 0.9, 0.7)
    assert f"KL(q||p) = {float(kl(q, P)):.2f}" in kl_picture(0.9, 2.0)
