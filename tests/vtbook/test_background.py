"""What chapter 2's page computes: Bellman's operator, a bias, the ELBO, Gibbs posteriors."""

from types import SimpleNamespace

import numpy as np
import pytest


@pytest.fixture(scope="module")
def background(cells_of):
    return SimpleNamespace(**cells_of("background"))


@pytest.fixture(params=[0.5, 0.9, 0.99])
def mdp(request, background):
    rng = np.random.default_rng(7)
    transition = rng.dirichlet(np.ones(6), size=(6, 3))
    return background.MDP(transition, rng.normal(size=(6, 3)), request.param)


def values_of(mdp, policy):
    """Action values (S, A) of a policy (S,), from the linear system that eq. 2.4 is."""
    taken = np.arange(len(policy)), policy
    step = np.eye(len(policy)) - mdp.gamma * mdp.transition[taken]
    return mdp.reward + mdp.gamma * mdp.transition @ np.linalg.solve(step, mdp.reward[taken])


def test_the_operator_leads_to_the_best_of_all_policies_at_the_rate_gamma(background, mdp):
    best = np.max([values_of(mdp, np.array(p)) for p in np.ndindex((3,) * 6)], 0)
    count = background.applications_until(1e-12, mdp.gamma)
    found = background.iterates(mdp, np.zeros((6, 3)), count)[-1]
    np.testing.assert_allclose(found, best, atol=1e-9)
    # a constant above the optimum shrinks by gamma everywhere, which is as slowly as can be
    moved = background.iterates(mdp, best + 2, 5) - best
    expected = 2 * mdp.gamma ** np.arange(6).reshape(6, 1, 1) * np.ones((6, 3))
    np.testing.assert_allclose(moved, expected, rtol=1e-9)
    assert background.applications_until(mdp.gamma**5, mdp.gamma) == 5


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


def test_a_conjugate_problem_has_its_known_evidence_and_posterior(background):
    # a prior, and an observation of y with noise of deviation 0.5: the posterior is a Gaussian
    prior = background.gaussian(0.4, 0.8)
    noise = -0.5 * ((1.8 - background.Y) / 0.5) ** 2 - np.log(0.5 * np.sqrt(2 * np.pi))
    deviation, variance = (1 / 0.8**2 + 1 / 0.5**2) ** -0.5, 0.8**2 + 0.5**2
    total = -0.5 * (1.8 - 0.4) ** 2 / variance - 0.5 * np.log(2 * np.pi * variance)
    assert background.log_evidence(prior, noise) == pytest.approx(total)
    exact = background.gaussian(deviation**2 * (0.4 / 0.8**2 + 1.8 / 0.5**2), deviation)
    np.testing.assert_allclose(background.log_posterior(prior, noise), exact, rtol=1e-9)
    # the bound misses the evidence by the KL divergence from the posterior
    for log_q in (exact, *map(background.gaussian, (-1.3, 0.0, 0.7), (0.15, 0.9, 0.3))):
        gap = background.kl(log_q, exact)
        assert gap > 0.1 or log_q is exact
        assert background.elbo(prior, noise, log_q) + gap == pytest.approx(total, abs=1e-9)


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
