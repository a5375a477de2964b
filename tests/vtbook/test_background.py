"""What chapter 2's page computes: a bias, and Gibbs posteriors with their bound."""

from types import SimpleNamespace

import numpy as np
import pytest


@pytest.fixture(scope="module")
def background(cells_of):
    return SimpleNamespace(**cells_of("background"))


@pytest.mark.parametrize("chance", [0.0, 0.2, 0.5])
def test_one_next_state_estimates_the_larger_error_and_two_the_smaller(background, chance):
    w = np.linspace(0.5, 1.2, 7001)
    bellman, td = background.squared_errors(w, chance)
    assert w[td.argmin()] == pytest.approx(background.best_scale(chance), abs=2e-4)
    some = w[::1000]
    errors = background.td_errors(some, chance, np.random.default_rng(0), 200_000)
    for estimate, exact in ((errors[0] ** 2, td[::1000]), (errors.prod(0), bellman[::1000])):
        slack = 4 * estimate.std(0) / len(estimate) ** 0.5 + 1e-12
        assert np.all(np.abs(estimate.mean(0) - exact) < slack)


@pytest.mark.parametrize("beta", [0.1, 1.0, 4.0])
def test_no_other_posterior_has_a_smaller_bound(background, beta):
    rng = np.random.default_rng(2)
    losses = background.draw_losses(400, rng)
    risk, weight = losses.mean(0), beta * len(losses)
    posteriors = [background.gibbs_posterior(risk, f * weight) for f in (1, 0.8, 1.25)]
    for share in (1e-3, 0.1, 1.0):
        stray = rng.dirichlet(np.full(len(risk), 9.0), size=20)
        posteriors += list(np.log((1 - share) * np.exp(posteriors[0]) + share * stray))
    parts = [(np.exp(q) @ risk, background.kl(q, background.LOG_PRIOR)) for q in posteriors]
    least, *bounds = [background.catoni_bound(*part, len(losses), beta) for part in parts]
    assert least == pytest.approx(background.risks(losses, 1 / beta)[2])
    assert all(bound > least for bound in bounds)
    # a small beta recovers the fit, and a charge for the distance
    small = background.catoni_bound(0.2, 1.5, 10**9, 1e-4)
    assert small == pytest.approx(0.2 + (1.5 + np.log(20)) / (1e-4 * 1e9), rel=1e-3)


def test_the_bound_fails_in_no_more_than_delta_of_the_samples(background):
    rng = np.random.default_rng(4)
    losses = background.draw_losses(100_000, rng)
    assert np.abs(losses.mean(0) - background.TRUE_RISK).max() < 0.008
    fresh = [background.risks(x, 1.0) for x in losses[:15_000].reshape(300, 50, -1)]
    empirical, true, bound = np.transpose(fresh)
    assert np.mean(true > bound) <= background.DELTA
    assert np.mean(true > empirical) > 0.3  # the empirical risk itself is no bound
