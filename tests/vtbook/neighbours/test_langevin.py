"""The chain: one step by its formula, and the law of its weights on a quadratic error."""

import pytest
import torch

from vtbook.neighbours import LangevinSettings
from vtlib.priors import GaussianPrior, MixturePrior
from vtlib.rng import Rng


@pytest.mark.parametrize("kind", ["gaussian", "mixture"])
def test_a_step_is_its_formula(kind, on_a_line):
    sources = torch.randn(2, 3, 2, generator=torch.Generator().manual_seed(0))
    how = {"lambda_": 0.1, "alpha": 0.02, "bias": 0.3, "jitter": 0.5, "sigma_p2": 0.2}
    agent, step = on_a_line(LangevinSettings(prior=kind, minibatch=2, **how), sources)
    noise = Rng("t", range(2)).stream("posterior")
    prior = GaussianPrior(sources, 0.5) if kind == "gaussian" else MixturePrior(sources, 0.2)
    w, m, v = sources.mean(1, keepdim=True), torch.zeros(1), torch.zeros(1)
    for t in range(1, 6):
        agent.learn(step)
        g = 2 * (w.sum(-1, keepdim=True) - 2.0) + 0.1 / t * prior.pull(w)
        m, v = 0.9 * m + 0.1 * g, 0.999 * v + 0.001 * g**2
        xi = noise.normal(2).unsqueeze(1)
        w = w - 0.02 * (g + 0.3 * m / (v + 1e-8) ** 0.5) + (2 * 0.02 * 0.1 / t) ** 0.5 * xi
        torch.testing.assert_close(agent.mu, w, rtol=1e-4, atol=1e-5)
