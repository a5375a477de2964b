"""The Gibbs posterior minimises Catoni's bound, and the bound holds."""

from __future__ import annotations

import re

import numpy as np
import pytest

from vtlib.illustrations import elbo
from vtlib.illustrations.gibbs import (
    catoni_bound,
    draw_losses,
    failures,
    gibbs_picture,
    gibbs_posterior,
    kl,
    outcome,
    thresholds,
    true_risk,
)

PROBLEM = thresholds(101)
PRIOR = np.exp(PROBLEM.log_prior)


@pytest.fixture(scope="module")
def losses() -> np.ndarray:
    return draw_losses(PROBLEM, 400, np.random.default_rng(0))


def bound_of(q: np.ndarray, losses: np.ndarray, beta: float) -> float:
    return catoni_bound(q @ losses.mean(0), kl(q, PRIOR), len(losses), beta, 0.05)


def test_the_prior_is_a_distribution_around_its_centre():
    assert PRIOR.sum() == pytest.approx(1)
    assert PROBLEM.h[PRIOR.argmax()] == pytest.approx(0.35)


def test_losses_have_the_true_risk_as_their_mean():
    many = draw_losses(PROBLEM, 100_000, np.random.default_rng(1)).mean(0)
    np.testing.assert_allclose(many, true_risk(PROBLEM), atol=0.008)
    assert PROBLEM.h[true_risk(PROBLEM).argmin()] == pytest.approx(PROBLEM.target)


def test_no_weight_leaves_the_prior_and_much_weight_finds_the_least_risk(losses):
    risk = losses.mean(0)
    np.testing.assert_allclose(gibbs_posterior(PROBLEM.log_prior, risk, 0.0), PRIOR)
    sharp = gibbs_posterior(PROBLEM.log_prior, risk, 1e6)
    assert sharp @ risk == pytest.approx(risk.min())


def test_ratios_of_the_posterior_follow_the_exponential(losses):
    risk = losses.mean(0)
    q = gibbs_posterior(PROBLEM.log_prior, risk, 30.0)
    expected = PRIOR[40] / PRIOR[70] * np.exp(-30 * (risk[40] - risk[70]))
    assert q[40] / q[70] == pytest.approx(expected)


@pytest.mark.parametrize("beta", [0.1, 1.0, 4.0])
def test_no_other_posterior_has_a_smaller_bound(losses, beta):
    best = gibbs_posterior(PROBLEM.log_prior, losses.mean(0), beta * len(losses))
    least, rng = bound_of(best, losses, beta), np.random.default_rng(2)
    for share in (1e-3, 0.1, 1.0):
        for _ in range(20):
            other = (1 - share) * best + share * rng.dirichlet(np.ones(len(best)))
            assert bound_of(other, losses, beta) > least
    for factor in (0.8, 1.25):  # of Lambda = beta N
        other = gibbs_posterior(PROBLEM.log_prior, losses.mean(0), factor * beta * len(losses))
        assert bound_of(other, losses, beta) > least


def test_risk_and_divergence_are_the_divergence_from_the_gibbs_posterior(losses):
    risk, weight = losses.mean(0), 25.0
    best = gibbs_posterior(PROBLEM.log_prior, risk, weight)
    log_constant = np.log((PRIOR * np.exp(-weight * risk)).sum())
    q = np.random.default_rng(3).dirichlet(np.ones(len(risk)))
    both = q @ risk + kl(q, PRIOR) / weight
    assert both == pytest.approx((kl(q, best) - log_constant) / weight)


def test_the_bound_in_known_cases():
    # one hypothesis that never errs: (1 - delta^(1/N)) / (1 - e^-beta)
    by_hand = (1 - 0.05 ** (1 / 50)) / (1 - np.exp(-2.0))
    assert catoni_bound(0.0, 0.0, 50, 2.0, 0.05) == pytest.approx(by_hand)
    # a small beta recovers risk + (KL + ln 1/delta) / (beta N)
    small = catoni_bound(0.2, 1.5, 10**9, 1e-4, 0.05)
    assert small == pytest.approx(0.2 + (1.5 + np.log(20)) / (1e-4 * 1e9), rel=1e-3)
    # at risk 1 and no divergence it is never below 1
    assert catoni_bound(1.0, 0.0, 50, 0.7, 1.0) == pytest.approx(1.0)


@pytest.mark.parametrize("lambda_", [0.25, 1.0, 4.0])
def test_the_bound_fails_in_no_more_than_delta_of_the_samples(lambda_):
    failed = failures(PROBLEM, 50, lambda_, 0.05, np.random.default_rng(4), sets=300)
    assert failed.shape == (300,)
    assert failed.mean() <= 0.05


def test_a_bound_without_the_divergence_would_fail_often():
    # what the terms in N are for: the same check tells a wrong bound from the right one
    rng, wrong = np.random.default_rng(5), []
    for _ in range(100):
        one = outcome(PROBLEM, draw_losses(PROBLEM, 10, rng), 0.05, 0.05)
        wrong.append(one.true > one.empirical)
    assert np.mean(wrong) > 0.5


def test_an_outcome_takes_lambda_as_the_inverse_of_beta(losses):
    one = outcome(PROBLEM, losses, 4.0, 0.05)
    q = gibbs_posterior(PROBLEM.log_prior, losses.mean(0), len(losses) / 4)
    np.testing.assert_array_equal(one.posterior, q)
    assert one.bound == bound_of(q, losses, 0.25)
    assert one.true == pytest.approx(q @ true_risk(PROBLEM))


def test_the_posterior_sharpens_with_more_samples_and_smaller_lambda(losses):
    def spread(count: int, lambda_: float) -> float:
        q = outcome(PROBLEM, losses[:count], lambda_, 0.05).posterior
        return np.sqrt(q @ PROBLEM.h**2 - (q @ PROBLEM.h) ** 2)

    assert spread(10, 1) > spread(100, 1) > spread(400, 1)
    assert spread(100, 16) > spread(100, 4) > spread(100, 1)


def test_negative_log_likelihood_as_loss_gives_the_bayesian_posterior():
    problem = elbo.square_problem()
    posterior = np.exp(elbo.log_posterior(problem))
    loss = -problem.log_likelihood  # of one sample, so Lambda = N = 1
    gibbs = gibbs_posterior(problem.log_prior, loss, 1.0)
    np.testing.assert_allclose(gibbs, posterior / posterior.sum(), atol=1e-15)


def test_the_picture_says_its_numbers(losses):
    html = gibbs_picture(PROBLEM, losses, [5, 50, 400], 50, 4.0, 0.05)
    alt = re.search('alt="([^"]*)"', html)[1]
    assert "N = 50 and lambda = 4:" in alt
    assert f"bound {outcome(PROBLEM, losses[:50], 4.0, 0.05).bound:.2f}" in alt
