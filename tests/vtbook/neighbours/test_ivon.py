"""IVON: its formulas step by step from the prior, and a conjugate posterior at its end."""

import torch

from vtbook.neighbours import IVONSettings
from vtlib.rng import Rng


def test_steps_are_those_of_the_source(on_a_line):
    sources = torch.randn(2, 3, 2, generator=torch.Generator().manual_seed(0))
    how = {"lambda_": 0.3, "alpha": 0.1, "n_samples": 2, "beta2": 0.9, "h0": 0.2, "jitter": 0.5}
    agent, step = on_a_line(IVONSettings(**how, clip=0.4, minibatch=3), sources)
    noise, g = Rng("t", range(2)).stream("posterior"), 0.0
    m = center = sources.mean(1, keepdim=True)
    h = torch.full_like(center, 0.2)
    spread = sources.var(1, correction=0, keepdim=True) + 0.5
    delta, ess = 0.3 / spread, 1 / 0.3  # before the first transition N counts as one
    for t in range(1, 8):
        z = noise.normal(6).view(2, 3, 2)
        sigma = (ess * (h + delta)) ** -0.5
        torch.testing.assert_close(agent.variance, sigma**2)
        w = (m + sigma * z)[:, 1:]
        torch.testing.assert_close(agent._samples[:, 1:], w, rtol=1e-4, atol=1e-5)
        agent.learn(step)
        gradients = 2 * (w.sum(-1, keepdim=True) - 2.0).expand(-1, -1, 2)
        delta, ess = 0.3 / (t * spread), t / 0.3
        hat = (gradients * (w - m) / sigma**2).mean(1, keepdim=True)
        h = 0.9 * h + 0.1 * hat + 0.5 * 0.1**2 * (h - hat) ** 2 / (h + delta)
        h = h.clamp(min=0)
        g = 0.9 * g + 0.1 * gradients.mean(1, keepdim=True)
        slope = (g / (1 - 0.9**t) + delta * (m - center)) / (h + delta)
        m = m - 0.1 * slope.clamp(-0.4, 0.4)
        torch.testing.assert_close(agent.mu, m, rtol=1e-4, atol=1e-5)


def test_on_a_quadratic_error_variances_become_those_of_the_conjugate_posterior(on_a_line):
    how = {"lambda_": 1.0, "alpha": 0.02, "h0": 0.5, "jitter": 2.0, "beta2": 0.99}
    agent, step = on_a_line(IVONSettings(**how, clip=5.0, minibatch=1), torch.zeros(200, 1, 2))
    for _ in range(600):
        agent.learn(step)
    # the squared error's curvature is 2 in each weight: precision 2 N / lambda + 1 / s^2
    ratio = agent.variance.mean() * (2 * 600 + 1 / 2.0)
    assert 0.9 < ratio < 1.1, ratio
    assert (agent.mu.sum(-1) - 2).abs().mean() < 0.1
