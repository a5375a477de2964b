"""The mean squared TD error is the squared Bellman error plus the variance of the targets."""

from __future__ import annotations

import re

import numpy as np
import pytest
import torch

from vtlib.illustrations.bellman import MDP, corridor, optimal_values
from vtlib.illustrations.td_bias import (
    best_scale,
    bias_picture,
    draw_sample,
    fork,
    squared_bellman_error,
    squared_td_error,
    target_variance,
    td_errors,
    uniform_but_last,
)
from vtlib.mellow import td_error

MANY = 200_000


@pytest.fixture
def case() -> tuple[MDP, np.ndarray, np.ndarray]:
    """A corridor that slips, values that are wrong, and an uneven measure."""
    mdp, rng = corridor(5, 0.3, 0.9), np.random.default_rng(3)
    return mdp, rng.normal(size=(6, 2)), rng.dirichlet(np.ones(12)).reshape(6, 2)


def test_values_of_the_fork():
    np.testing.assert_allclose(optimal_values(fork(0.3, 0.9))[:, 0], [0.27, 1, 0, 0])


def test_expectation_over_every_next_state_is_the_mean_of_squares(case):
    mdp, q, nu = case
    b = mdp.reward[..., None] + mdp.gamma * q.max(1) - q[..., None]  # (S, A, next)
    by_hand = (nu * (mdp.transition * b**2).sum(-1)).sum()
    assert squared_td_error(mdp, q, nu) == pytest.approx(by_hand)
    mean = (mdp.transition * b).sum(-1)
    assert squared_bellman_error(mdp, q, nu) == pytest.approx((nu * mean**2).sum())


def test_without_chance_there_is_no_bias(case):
    _, q, nu = case
    mdp = corridor(5, 0.0, 0.9)
    np.testing.assert_allclose(target_variance(mdp, q), 0, atol=1e-12)
    assert squared_td_error(mdp, q, nu) == pytest.approx(squared_bellman_error(mdp, q, nu))


@pytest.mark.parametrize("chance", [0.1, 0.5, 0.8])
def test_true_values_have_a_squared_td_error_but_no_bellman_error(chance):
    mdp = fork(chance, 0.9)
    nu, best = uniform_but_last(mdp), optimal_values(mdp)
    assert squared_bellman_error(mdp, best, nu) == pytest.approx(0, abs=1e-15)
    assert squared_td_error(mdp, best, nu) == pytest.approx(0.81 * chance * (1 - chance) / 3)


@pytest.mark.parametrize("chance", [0.0, 0.2, 0.5])
def test_the_best_scale_minimises_the_squared_td_error(chance):
    mdp = fork(chance, 0.95)
    nu, best = uniform_but_last(mdp), optimal_values(mdp)
    scales = np.linspace(0.5, 1.2, 7001)
    errors = squared_td_error(mdp, scales[:, None, None] * best, nu)
    assert scales[errors.argmin()] == pytest.approx(best_scale(chance, 0.95), abs=2e-4)


def test_one_next_state_estimates_the_larger_and_two_the_smaller(case):
    mdp, q, nu = case
    sample = draw_sample(mdp, nu, MANY, np.random.default_rng(0))
    first = td_errors(sample, q, mdp.gamma)
    product = first * td_errors(sample, q, mdp.gamma, other=True)
    td, bellman = squared_td_error(mdp, q, nu), squared_bellman_error(mdp, q, nu)
    for estimate, target in ((first**2, td), (product, bellman)):
        error = estimate.std() / np.sqrt(MANY)
        assert abs(estimate.mean() - target) < 4 * error
        assert error < (td - bellman) / 20  # else the two could not be told apart


def test_a_sample_follows_the_measure_and_the_transitions(case):
    mdp, _, nu = case
    sample = draw_sample(mdp, nu, MANY, np.random.default_rng(1))
    seen = np.zeros((6, 2))
    np.add.at(seen, (sample.state, sample.action), 1 / MANY)
    np.testing.assert_allclose(seen, nu, atol=0.005)
    at = (sample.state == 2) & (sample.action == 1)
    for after in (sample.after, sample.other):
        assert set(after[at]) == {1, 3}
        assert np.mean(after[at] == 3) == pytest.approx(0.7, abs=0.02)
    both = np.mean((sample.after[at] == 3) & (sample.other[at] == 3))
    assert both == pytest.approx(0.49, abs=0.02)  # independent of each other


def test_the_mellow_td_error_comes_close_when_kappa_is_large(case):
    mdp, q, nu = case
    sample = draw_sample(mdp, nu, 50, np.random.default_rng(2))
    table = torch.from_numpy(q.T)  # actions before transitions
    mellow = td_error(
        table[:, sample.state],
        table[:, sample.after],
        torch.from_numpy(sample.action),
        torch.from_numpy(sample.reward),
        torch.zeros(50, dtype=torch.bool),
        gamma=mdp.gamma,
        kappa=1e6,
    )
    np.testing.assert_allclose(mellow.numpy(), td_errors(sample, q, mdp.gamma), atol=1e-5)


def test_the_picture_says_where_the_minimum_lies():
    html = bias_picture(0.5, 0.9, 50, np.random.default_rng(0))
    alt = re.search('alt="([^"]*)"', html)[1]
    assert "c = 0.5" in alt
    assert f"least at w = {1 / (1 + 0.81 / 4):.2f}" in alt
