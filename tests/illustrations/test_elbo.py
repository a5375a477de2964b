"""Evidence, ELBO and KL by quadrature, against closed forms."""

from __future__ import annotations

import re

import numpy as np
import pytest
import torch

from vtlib import gaussian
from vtlib.illustrations.elbo import (
    Problem,
    best_gaussian,
    elbo,
    elbo_picture,
    integral,
    kl,
    log_evidence,
    log_posterior,
    normal_log_density,
    square_problem,
)

Y = np.linspace(-12, 12, 4801)
WIDE = torch.float64


def conjugate(observed: float, noise: float) -> Problem:
    """A Gaussian prior N(1, 4) and one noisy observation of y."""
    return Problem(Y, normal_log_density(Y, 1.0, 2.0), normal_log_density(Y, observed, noise))


def test_a_conjugate_problem_has_its_known_evidence_and_posterior():
    problem = conjugate(3.0, 0.5)
    evidence = normal_log_density(np.array(3.0), 1.0, np.sqrt(4 + 0.25))
    assert log_evidence(problem) == pytest.approx(float(evidence), abs=1e-10)
    precision = 1 / 4 + 1 / 0.25
    mean = (1 / 4 + 3 / 0.25) / precision
    expected = normal_log_density(Y, mean, precision**-0.5)
    np.testing.assert_allclose(log_posterior(problem), expected, atol=1e-9)


def test_the_posterior_is_a_density_with_two_unequal_peaks():
    problem = square_problem()
    density = np.exp(log_posterior(problem))
    assert integral(problem.y, density) == pytest.approx(1)
    inside = density[1:-1]
    peaks = problem.y[1:-1][(inside > density[:-2]) & (inside > density[2:])]
    assert len(peaks) == 2
    assert peaks[0] < 0 < peaks[1]
    right = integral(problem.y, density * (problem.y > 0))
    assert 0.55 < right < 0.75


@pytest.mark.parametrize("mean", [-1.3, 0.0, 0.7])
@pytest.mark.parametrize("deviation", [0.15, 0.3, 0.9])
def test_elbo_and_kl_add_up_to_the_evidence(mean, deviation):
    problem = square_problem()
    log_q = normal_log_density(problem.y, mean, deviation)
    gap = kl(problem.y, log_q, log_posterior(problem))
    assert gap > 0.1
    assert elbo(problem, log_q) + gap == pytest.approx(log_evidence(problem), abs=1e-9)


def test_kl_agrees_with_the_closed_form_of_gaussians():
    numbers = kl(Y, normal_log_density(Y, 0.5, 0.8), normal_log_density(Y, -0.4, 1.7))
    closed = gaussian.kl(
        gaussian.Gaussian(torch.tensor([0.5], dtype=WIDE), torch.tensor([[0.8]], dtype=WIDE)),
        gaussian.Gaussian(torch.tensor([-0.4], dtype=WIDE), torch.tensor([[1.7]], dtype=WIDE)),
    )
    assert numbers == pytest.approx(closed.item(), abs=1e-10)


def test_kl_is_not_symmetric_and_vanishes_for_equals():
    narrow, wide = normal_log_density(Y, 0, 0.5), normal_log_density(Y, 0, 1.5)
    assert kl(Y, narrow, narrow) == 0
    assert kl(Y, wide, narrow) > 2 * kl(Y, narrow, wide) > 0


def test_the_bound_is_tight_at_the_posterior_alone():
    problem = conjugate(3.0, 0.5)
    assert elbo(problem, log_posterior(problem)) == pytest.approx(log_evidence(problem), abs=1e-9)
    precision = 1 / 4 + 1 / 0.25
    means, deviations = (1 / 4 + 3 / 0.25) / precision + np.array([-0.1, 0, 0.1]), [0.4, 0.6]
    found = best_gaussian(problem, means, [*deviations, precision**-0.5])
    assert found[0] == pytest.approx(log_evidence(problem), abs=1e-9)
    assert found[1:] == (means[1], precision**-0.5)


def test_the_best_gaussian_sits_on_the_larger_peak():
    problem = square_problem()
    bound, mean, deviation = best_gaussian(
        problem, np.linspace(-2, 2, 81), np.linspace(0.1, 1.2, 45)
    )
    right = integral(problem.y, np.exp(log_posterior(problem)) * (problem.y > 0))
    assert 1.1 < mean < 1.5
    assert deviation < 0.4
    # a distribution that lives on one side misses the other: KL is at least -log of its mass
    assert -np.log(right) <= log_evidence(problem) - bound < -np.log(right) + 0.1


def test_the_picture_says_the_sum():
    problem = square_problem()
    alt = re.search('alt="([^"]*)"', elbo_picture(problem, 0.6, 0.3))[1]
    assert "mean 0.6 and deviation 0.3" in alt
    assert f"their sum {log_evidence(problem):.2f}" in alt
