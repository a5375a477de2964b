"""The parts of the KL of two Gaussians, the pull of its gradient, and the drawn ellipses."""

from __future__ import annotations

import pytest
import torch

from vtlib.illustrations.gaussian_kl import ellipse, kl_parts, planar, pull
from vtlib.priors import Gaussian, kl

P = planar(0.0, 0.6, 1.0)
CASES = [planar(s, c, k) for s in (0.0, 1.5) for c in (-0.8, 0.3, 0.9) for k in (0.5, 1.3)]


@pytest.mark.parametrize("q", CASES)
def test_parts_are_the_terms_of_eq_5_7_and_pull_is_minus_eq_5_8(q: Gaussian):
    covariance, prior = (one.scale_tril @ one.scale_tril.T for one in (q, P))
    volume, spread, shift = kl_parts(q, P)
    torch.testing.assert_close(volume, 0.5 * (torch.logdet(prior) - torch.logdet(covariance)))
    torch.testing.assert_close(spread, 0.5 * (torch.linalg.solve(prior, covariance).trace() - 2))
    torch.testing.assert_close(shift, 0.5 * q.mu @ torch.linalg.solve(prior, q.mu))
    torch.testing.assert_close(volume + spread + shift, kl(q, P))
    torch.testing.assert_close(pull(q, P), -torch.linalg.solve(prior, q.mu))


def test_ellipse_lies_at_its_mahalanobis_distance_and_closes():
    q = planar(1.0, 0.8, 0.7)
    points = ellipse(q, 2.0)
    distance = torch.linalg.solve(q.scale_tril, (points - q.mu).T).norm(dim=0)
    torch.testing.assert_close(distance, torch.full_like(distance, 2.0))
    torch.testing.assert_close(points[0], points[-1])
