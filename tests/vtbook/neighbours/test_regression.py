"""Regression: last layers in which Q is linear, the exact posterior, and its samples."""

import pytest
import torch

from vtbook.neighbours import RegressionSettings
from vtbook.neighbours.last_layer import LastLayer
from vtlib.priors import sources_mean_and_spread
from vtlib.qfunctions import MLP, RBFLinear
from vtlib.replay import Transition
from vtlib.rng import Rng

RUNS = 2
FUNCTIONS = [RBFLinear(torch.arange(3.0), 0.5, 2), MLP((2, 4, 2)), MLP((2, 3, 4, 2))]


def learned(q, count, **settings):
    """An agent after some transitions, with its sources and those transitions."""
    g, steps = torch.Generator().manual_seed(1), []
    sources = torch.randn(RUNS, 4, q.d, generator=g)
    agent = RegressionSettings(minibatch=4, **settings).agent(q, sources, 2, Rng("t", range(RUNS)))
    for _ in range(count):
        obs, reward = torch.rand(2, RUNS, 2, generator=g), torch.rand(RUNS, generator=g)
        action, done = torch.randint(2, (RUNS,), generator=g), torch.rand(RUNS, generator=g) < 0.3
        steps.append(Transition(obs[0], action, reward, obs[1], done))
        agent.act(obs[0], torch.ones(RUNS, dtype=torch.bool))
        agent.learn(steps[-1])
    return agent, sources, steps


@pytest.mark.parametrize("q", FUNCTIONS)
def test_the_posterior_is_that_of_bayesian_linear_regression_in_the_last_weights(q):
    noise, jitter = 0.3, 0.2
    agent, sources, steps = learned(q, 15, noise=noise, every=100, jitter=jitter, recent=12)
    A, b = agent.posterior()
    layer, x = LastLayer(q), q.prepare(torch.rand(RUNS, 5, 2))
    last = layer.last.flatten()
    values = agent.mu[:, 0][:, layer.last] @ layer.features(agent.mu, x)
    torch.testing.assert_close(values, q.q(agent.mu, x)[:, 0])
    mean, spread = sources_mean_and_spread(sources[..., last].double())
    for run in range(RUNS):
        prior = (spread[run] @ spread[run].T + jitter * torch.eye(len(last))).inverse()
        phi, y = torch.zeros(12, *layer.last.shape).double(), torch.zeros(12).double()
        for row, t in enumerate(steps[3:]):
            here, there = (q.prepare(x[run].view(1, 1, -1)) for x in (t.obs, t.next_obs))
            phi[row, t.action[run]] = layer.features(agent.mu[[run]], here)[0, :, 0].double()
            value = q.q(agent._sample[[run]], there).max()
            y[row] = t.reward[run] + 0.99 * value * (not t.terminated[run])
        phi = phi.flatten(1)
        precision = prior + phi.T @ phi / noise**2
        exact = torch.linalg.solve(precision, prior @ mean[run] + phi.T @ y / noise**2)
        torch.testing.assert_close(A[run], precision, rtol=1e-3, atol=1e-3)
        torch.testing.assert_close(torch.linalg.solve(A[run], b[run]), exact, rtol=1e-2, atol=1e-3)


def test_samples_have_the_mean_and_the_covariance_of_the_posterior():
    q, runs = MLP((1, 1)), 5_000
    agent = RegressionSettings().agent(q, torch.zeros(runs, 1, 2), 1, Rng("t", range(runs)))
    A = torch.tensor([[2.0, 0.5], [0.5, 1.0]])
    agent._draw(A.expand(runs, -1, -1), torch.ones(runs, 2))
    mean = torch.linalg.solve(A, torch.ones(2))
    torch.testing.assert_close(agent.mu[0, 0], mean)
    assert (agent._drawn.mean(0) - mean).abs().max() < 5 * 2**0.5 / runs**0.5
    torch.testing.assert_close(agent._drawn.T.cov(), A.inverse(), rtol=0.1, atol=0.03)


def test_layers_below_the_last_learn_and_the_last_waits_for_its_regression():
    q = MLP((2, 4, 2))
    last = LastLayer(q).last
    for count in (1, 9, 10):
        agent, sources, _ = learned(q, count, every=10)
        moved = (agent.mu != sources.mean(1, keepdim=True)).any(0)[0]
        assert moved[last].any() == (count == 10)
        moved[last] = False
        assert moved.any()
