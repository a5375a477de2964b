"""IVON: its formulas step by step, its start at the prior, and a conjugate posterior at its end."""

from __future__ import annotations

import torch

from vtbook.neighbours import IVONSettings
from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.rng import Rng

LINE = MLP((1, 1))


def at_one(runs, reward):
    one, yes = torch.ones(runs, 1), torch.ones(runs, dtype=torch.bool)
    return Transition(one, torch.zeros(runs).long(), torch.full((runs,), reward), one, yes)


def test_steps_are_those_of_the_source():
    sources = torch.randn(2, 3, LINE.d, generator=torch.Generator().manual_seed(0))
    settings = IVONSettings(
        lambda_=0.3, alpha=0.1, n_samples=2, beta2=0.9, h0=0.2, jitter=0.5, clip=0.4, minibatch=3
    )
    agent = settings.agent(LINE, sources, 1, Rng("t", range(2)))
    noise = Rng("t", range(2)).stream("posterior")
    center = sources.mean(1, keepdim=True)
    m, h, g = center, torch.full_like(center, 0.2), 0.0
    spread = sources.var(1, correction=0, keepdim=True) + 0.5
    delta, ess = 0.3 / spread, 1 / 0.3  # before the first transition N counts as one
    for t in range(1, 8):
        z = noise.normal(3 * LINE.d).view(2, 3, LINE.d)
        sigma = (ess * (h + delta)) ** -0.5
        w = (m + sigma * z)[:, 1:]
        torch.testing.assert_close(agent._samples[:, 1:], w, rtol=1e-4, atol=1e-5)
        agent.learn(at_one(2, 2.0))
        gradients = 2 * (w.sum(-1, keepdim=True) - 2.0).expand(-1, -1, LINE.d)
        delta, ess = 0.3 / (t * spread), t / 0.3
        hat = (gradients * (w - m) / sigma**2).mean(1, keepdim=True)
        h = 0.9 * h + 0.1 * hat + 0.5 * 0.1**2 * (h - hat) ** 2 / (h + delta)
        h = h.clamp(min=0)
        g = 0.9 * g + 0.1 * gradients.mean(1, keepdim=True)
        step = (g / (1 - 0.9**t) + delta * (m - center)) / (h + delta)
        m = m - 0.1 * step.clamp(-0.4, 0.4)
        torch.testing.assert_close(agent.mu, m, rtol=1e-4, atol=1e-5)


def test_without_curvature_the_posterior_starts_as_the_prior():
    sources = torch.randn(1, 5, LINE.d, generator=torch.Generator().manual_seed(1))
    agent = IVONSettings(lambda_=0.5, h0=1e-30).agent(LINE, sources, 1, Rng("t", [0]))
    expected = sources.var(1, correction=0, keepdim=True) + 1e-4
    torch.testing.assert_close(agent.variance, expected)


def test_on_a_quadratic_error_variances_become_those_of_the_conjugate_posterior():
    runs, steps, lambda_ = 200, 1500, 1.0
    sources = torch.zeros(runs, 1, LINE.d)
    settings = IVONSettings(
        lambda_=lambda_, alpha=0.02, h0=0.5, jitter=2.0, beta2=0.99, clip=5.0, minibatch=1
    )
    agent = settings.agent(LINE, sources, 1, Rng("t", range(runs)))
    for _ in range(steps):
        agent.learn(at_one(runs, 1.0))
    # the squared error's curvature is 2 in each weight: precision 2 N / lambda + 1 / s^2
    exact = 1 / (2 * steps / lambda_ + 1 / 2.0)
    ratio = agent.variance.mean() / exact
    assert 0.9 < ratio < 1.1, ratio
    assert (agent.mu.sum(-1) - 1).abs().mean() < 0.1
