"""Bellman operators of a finite MDP: fixed points, contraction, and the rate of both."""

from __future__ import annotations

import numpy as np
import pytest

from vtlib.illustrations import bellman


@pytest.fixture(params=[0.5, 0.9, 0.99])
def mdp(request) -> bellman.MDP:
    rng = np.random.default_rng(7)
    transition = rng.dirichlet(np.ones(6), size=(6, 3))
    return bellman.MDP(transition, rng.normal(size=(6, 3)), request.param)


def test_values_of_a_policy_are_the_discounted_rewards_and_a_fixed_point(mdp: bellman.MDP):
    policy, states = np.array([0, 2, 1, 1, 0, 2]), np.arange(6)
    step, reward = mdp.transition[states, policy], mdp.reward[states, policy]
    v, ahead = np.zeros(6), np.eye(6)
    for t in range(4000):  # the series of eq. 2.2
        v += mdp.gamma**t * ahead @ reward
        ahead = ahead @ step
    q = bellman.policy_values(mdp, policy)
    np.testing.assert_allclose(q, mdp.reward + mdp.gamma * mdp.transition @ v, atol=1e-9)
    np.testing.assert_allclose(bellman.policy_operator(mdp, policy, q), q, atol=1e-10)


def test_optimal_values_are_the_best_of_all_policies(mdp: bellman.MDP):
    all_policies = map(np.array, np.ndindex(3, 3, 3, 3, 3, 3))
    best = np.max([bellman.policy_values(mdp, policy) for policy in all_policies], 0)
    np.testing.assert_allclose(bellman.optimal_values(mdp), best, atol=1e-9)


def test_the_optimal_operator_contracts_and_a_constant_shift_attains_the_rate(mdp: bellman.MDP):
    a, b = np.random.default_rng(1).normal(scale=3, size=(2, 200, 6, 3))
    after = bellman.sup_distance(*(bellman.optimal_operator(mdp, q) for q in (a, b)))
    assert np.all(after <= mdp.gamma * bellman.sup_distance(a, b) * (1 + 1e-12))
    best = bellman.optimal_values(mdp)
    distances = bellman.sup_distance(bellman.iterates(mdp, best + 2, 5), best)
    np.testing.assert_allclose(distances, 2 * mdp.gamma ** np.arange(6), rtol=1e-9)
    assert bellman.applications_until(mdp.gamma**5, mdp.gamma) == 5
