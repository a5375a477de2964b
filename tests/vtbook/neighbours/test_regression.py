"""Regression: last layers in which Q is linear, the exact posterior, and its samples."""

from __future__ import annotations

import pytest
import torch

from vtbook.neighbours import RegressionSettings
from vtlib.priors import sources_mean_and_spread
from vtlib.qfunctions import MLP, RBFLinear
from vtlib.replay import Transition
from vtlib.rng import Rng

FUNCTIONS = [RBFLinear(torch.arange(3.0), 0.5, 2), MLP((2, 4, 2)), MLP((2, 3, 4, 2))]


def normal(*shape, seed=0):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def transitions(runs, count):
    for t in range(count):
        g = torch.Generator().manual_seed(t)
        obs = torch.rand(2, runs, 2, generator=g)
        action, done = torch.randint(2, (runs,), generator=g), torch.rand(runs, generator=g) < 0.3
        yield Transition(obs[0], action, torch.rand(runs, generator=g), obs[1], done)


@pytest.mark.parametrize("q", FUNCTIONS)
def test_values_are_linear_in_the_last_weights(q):
    w, x = normal(3, 1, q.d), q.prepare(torch.rand(3, 5, 2))
    values = w[:, 0][:, q.last] @ q.features(w, x)
    torch.testing.assert_close(values, q.q(w, x)[:, 0])


@pytest.mark.parametrize("q", FUNCTIONS)
def test_the_posterior_is_that_of_bayesian_linear_regression(q):
    runs, noise, jitter = 2, 0.3, 0.2
    sources = normal(runs, 4, q.d)
    settings = RegressionSettings(noise=noise, every=100, jitter=jitter, minibatch=4, recent=12)
    agent = settings.agent(q, sources, 2, Rng("t", range(runs)))
    for step in transitions(runs, 15):
        agent.act(step.obs, torch.ones(runs, dtype=torch.bool))
        agent.learn(step)
    A, b = agent.posterior()
    seen = list(transitions(runs, 15))[3:]  # the last twelve
    last = q.last.flatten()
    mean, spread = sources_mean_and_spread(sources[..., last].double())
    for run in range(runs):
        covariance = spread[run] @ spread[run].T + jitter * torch.eye(len(last))
        rows, targets = [], []
        for t in seen:
            here = q.prepare(t.obs[run].view(1, 1, -1))
            there = q.prepare(t.next_obs[run].view(1, 1, -1))
            row = torch.zeros_like(q.last, dtype=torch.double)
            row[t.action[run]] = q.features(agent.mu[run : run + 1], here)[0, :, 0].double()
            rows.append(row.flatten())
            value = q.q(agent._sample[run : run + 1], there).max()
            targets.append(t.reward[run] + 0.99 * value * (not t.terminated[run]))
        phi, y = torch.stack(rows), torch.stack(targets).double()
        precision = covariance.inverse() + phi.T @ phi / noise**2
        exact = torch.linalg.solve(
            precision, covariance.inverse() @ mean[run] + phi.T @ y / noise**2
        )
        torch.testing.assert_close(A[run].double(), precision, rtol=1e-3, atol=1e-3)
        torch.testing.assert_close(
            torch.linalg.solve(A[run].double(), b[run].double()), exact, rtol=1e-2, atol=1e-3
        )


def test_samples_have_the_mean_and_the_covariance_of_the_posterior():
    q, runs = MLP((1, 1)), 20_000
    sources = torch.tensor([[1.0, 0.0], [2.0, 1.5]]).expand(runs, -1, -1)
    agent = RegressionSettings(jitter=0.5).agent(q, sources, 1, Rng("t", range(runs)))
    A = torch.tensor([[2.0, 0.5], [0.5, 1.0]]).expand(runs, -1, -1)
    agent._draw(A, torch.ones(runs, 2))
    mean = torch.linalg.solve(A[0], torch.ones(2))
    torch.testing.assert_close(agent.mu[0, 0], mean)
    assert (agent._drawn.mean(0) - mean).abs().max() < 5 * 2**0.5 / runs**0.5
    torch.testing.assert_close(agent._drawn.T.cov(), A[0].inverse(), rtol=0.1, atol=0.03)


def test_layers_below_the_last_learn_and_the_last_waits_for_its_regression():
    q = MLP((2, 4, 2))
    agent = RegressionSettings(every=10, minibatch=4).agent(q, normal(1, 3, q.d), 2, Rng("t", [0]))
    before, last = agent.mu.clone(), q.last.flatten()
    below = torch.ones(q.d, dtype=torch.bool)
    below[last] = False
    for t, step in enumerate(transitions(1, 10), 1):
        agent.act(step.obs, torch.ones(1, dtype=torch.bool))
        agent.learn(step)
        moved = agent.mu[0, 0] != before[0, 0]
        assert moved[below].any()
        assert moved[last].any() == (t == 10)
