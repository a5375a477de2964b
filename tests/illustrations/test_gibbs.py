"""The Gibbs posterior minimises Catoni's bound, and the bound holds."""

from __future__ import annotations

import numpy as np
import pytest

from vtlib.illustrations.elbo import kl
from vtlib.illustrations.gibbs import (
    DELTA,
    LOG_PRIOR,
    H,
    catoni_bound,
    draw_losses,
    gibbs_posterior,
    risks,
    true_risk,
)


@pytest.mark.parametrize("beta", [0.1, 1.0, 4.0])
def test_no_other_posterior_has_a_smaller_bound(beta: float):
    rng = np.random.default_rng(2)
    losses = draw_losses(400, rng)
    risk, weight = losses.mean(0), beta * len(losses)
    posteriors = [gibbs_posterior(risk, f * weight) for f in (1, 0.8, 1.25)]
    for share in (1e-3, 0.1, 1.0):
        stray = rng.dirichlet(np.full(len(H), 9.0), size=20)
        posteriors += list(np.log((1 - share) * np.exp(posteriors[0]) + share * stray))
    parts = [(np.exp(log_q) @ risk, kl(log_q, LOG_PRIOR)) for log_q in posteriors]
    least, *bounds = [catoni_bound(*part, len(losses), beta, DELTA) for part in parts]
    assert least == pytest.approx(risks(losses, 1 / beta)[2])
    assert all(bound > least for bound in bounds)


def test_a_small_beta_recovers_fit_and_a_charge_for_the_distance():
    small = catoni_bound(0.2, 1.5, 10**9, 1e-4, 0.05)
    assert small == pytest.approx(0.2 + (1.5 + np.log(20)) / (1e-4 * 1e9), rel=1e-3)


def test_the_bound_fails_in_no_more_than_delta_of_the_samples():
    rng = np.random.default_rng(4)
    assert np.abs(draw_losses(100_000, rng).mean(0) - true_risk()).max() < 0.008
    fresh = np.array([risks(draw_losses(50, rng), 1.0) for _ in range(300)])
    assert np.mean(fresh[:, 1] > fresh[:, 2]) <= DELTA
    assert np.mean(fresh[:, 1] > fresh[:, 0]) > 0.3  # the empirical risk itself is no bound
