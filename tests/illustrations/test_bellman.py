"""Bellman operators of a finite MDP: fixed points, contraction, and the rate of both."""

from __future__ import annotations

import re

import numpy as np
import pytest

from vtlib.illustrations.bellman import (
    MDP,
    applications_until,
    bellman_error,
    contraction_picture,
    corridor,
    iterates,
    optimal_operator,
    optimal_values,
    policy_operator,
    policy_values,
    sup_distance,
)

GAMMAS = (0.5, 0.9, 0.99)


def random_mdp(rng: np.random.Generator, gamma: float) -> MDP:
    transition = rng.dirichlet(np.ones(6), size=(6, 3))
    return MDP(transition, rng.normal(size=(6, 3)), gamma)


@pytest.fixture(params=GAMMAS)
def mdp(request) -> MDP:
    return random_mdp(np.random.default_rng(7), request.param)


def test_every_row_of_the_corridor_is_a_distribution():
    transition = corridor(5, 0.3, 0.9).transition
    assert np.all(transition >= 0)
    np.testing.assert_allclose(transition.sum(-1), 1)


def test_values_of_a_corridor_without_slips_are_powers_of_gamma():
    best = optimal_values(corridor(6, 0.0, 0.8))
    np.testing.assert_allclose(best[:6, 1], 0.8 ** np.arange(5, -1, -1))
    np.testing.assert_allclose(best[1:5, 0], 0.8 ** np.arange(6, 2, -1))
    np.testing.assert_array_equal(best[6], 0)


def test_slips_lower_the_values():
    best, slipping = (optimal_values(corridor(6, slip, 0.8)) for slip in (0.0, 0.2))
    assert np.all(slipping[:5, 1] < best[:5, 1])


def test_values_of_a_policy_are_the_expected_discounted_rewards(mdp):
    policy = np.array([0, 2, 1, 1, 0, 2])
    states = np.arange(6)
    step, reward = mdp.transition[states, policy], mdp.reward[states, policy]
    v, ahead = np.zeros(6), np.eye(6)
    for t in range(4000):  # the series of eq. 2.2
        v += mdp.gamma**t * ahead @ reward
        ahead = ahead @ step
    q = mdp.reward + mdp.gamma * mdp.transition @ v
    np.testing.assert_allclose(policy_values(mdp, policy), q, atol=1e-9)


def test_fixed_points(mdp):
    policy = np.array([0, 2, 1, 1, 0, 2])
    q = policy_values(mdp, policy)
    np.testing.assert_allclose(policy_operator(mdp, policy, q), q, atol=1e-10)
    np.testing.assert_allclose(bellman_error(mdp, optimal_values(mdp)), 0, atol=1e-10)
    assert np.abs(bellman_error(mdp, q)).max() > 0.01


def test_no_policy_beats_the_optimal_values(mdp):
    best = optimal_values(mdp)
    for policy in np.ndindex(3, 3, 3, 3, 3, 3):
        assert np.all(policy_values(mdp, np.array(policy)) <= best + 1e-9)


def test_both_operators_contract_at_rate_gamma(mdp):
    rng = np.random.default_rng(1)
    a, b = rng.normal(scale=3, size=(2, 200, 6, 3))
    policy = rng.integers(3, size=6)
    before = sup_distance(a, b)
    assert np.all(
        sup_distance(optimal_operator(mdp, a), optimal_operator(mdp, b))
        <= mdp.gamma * before * (1 + 1e-12)
    )
    assert np.all(
        sup_distance(policy_operator(mdp, policy, a), policy_operator(mdp, policy, b))
        <= mdp.gamma * before * (1 + 1e-12)
    )


def test_the_rate_is_attained_by_a_constant_shift(mdp):
    best = optimal_values(mdp)
    path = iterates(mdp, best + 2, 5)
    np.testing.assert_allclose(sup_distance(path, best), 2 * mdp.gamma ** np.arange(6), rtol=1e-9)


def test_operators_take_a_batch_as_they_take_each_member(mdp):
    rng = np.random.default_rng(2)
    q, policy = rng.normal(size=(4, 5, 6, 3)), rng.integers(3, size=6)
    one = q[2, 3]
    np.testing.assert_allclose(optimal_operator(mdp, q)[2, 3], optimal_operator(mdp, one))
    np.testing.assert_allclose(
        policy_operator(mdp, policy, q)[2, 3], policy_operator(mdp, policy, one)
    )


@pytest.mark.parametrize("gamma", GAMMAS)
def test_applications_until_is_the_first_that_suffices(gamma):
    k = applications_until(0.01, gamma)
    assert gamma**k <= 0.01 < gamma ** (k - 1)


def test_applications_until_does_not_round_an_exact_power_up():
    assert applications_until(0.125, 0.5) == 3


def test_the_picture_says_which_share_is_left():
    mdp = corridor(6, 0.1, 0.9)
    html = contraction_picture(mdp, np.random.default_rng(0).normal(size=(7, 2)), count=20)
    alt = re.search('alt="([^"]*)"', html)[1]
    assert "gamma = 0.9" in alt
    assert f"the bound is {0.9**20:.1e}" in alt
    assert f"{0.9**20:.1e} from optimum + 1" in alt
