"""The mean squared TD error is the squared Bellman error plus the variance of the targets."""

from __future__ import annotations

import numpy as np
import pytest

from vtlib.illustrations import td_bias
from vtlib.illustrations.bellman import MDP, optimal_values

Case = tuple[MDP, np.ndarray, np.ndarray]


@pytest.fixture
def case() -> Case:
    """An MDP, values that are wrong, and an uneven measure."""
    rng = np.random.default_rng(3)
    mdp = MDP(rng.dirichlet(np.ones(6), size=(6, 2)), rng.normal(size=(6, 2)), 0.9)
    return mdp, rng.normal(size=(6, 2)), rng.dirichlet(np.ones(12)).reshape(6, 2)


@pytest.mark.parametrize("chance", [0.0, 0.2, 0.5])
def test_errors_along_the_true_values_of_a_coin_in_closed_form(page, chance: float):
    mdp, nu = page("background")["fork"](chance), page("background")["nu"]
    w, best = np.linspace(0.5, 1.2, 7001), optimal_values(mdp)
    np.testing.assert_allclose(best[:, 0], [0.95 * chance, 1, 0, 0])
    q, variance = w[:, None, None] * best, 0.95**2 * w**2 * chance * (1 - chance)
    bellman_errors, errors = (
        error(mdp, q, nu) for error in (td_bias.squared_bellman_error, td_bias.squared_td_error)
    )
    np.testing.assert_allclose(bellman_errors, (1 - w) ** 2 / 3, atol=1e-12)
    np.testing.assert_allclose(errors, ((1 - w) ** 2 + variance) / 3, atol=1e-12)
    assert w[errors.argmin()] == pytest.approx(td_bias.best_scale(chance, 0.95), abs=2e-4)


def test_one_next_state_estimates_the_larger_and_two_the_smaller(case: Case):
    mdp, q, nu = case
    errors = td_bias.td_errors(
        mdp, td_bias.draw_sample(mdp, nu, 200_000, np.random.default_rng(0)), q
    )
    td, bellman = td_bias.squared_td_error(*case), td_bias.squared_bellman_error(*case)
    for estimate, target in ((errors[0] ** 2, td), (errors.prod(0), bellman)):
        error = estimate.std() / len(estimate) ** 0.5
        assert abs(estimate.mean() - target) < 4 * error
        assert error < (td - bellman) / 20  # else the two could not be told apart
