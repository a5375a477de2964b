"""Coverage: closed forms, a calibrated posterior, and one that is too sure of itself."""

from statistics import NormalDist

import numpy as np
import torch

from vtbook.credible_intervals import LEVELS, inside, posterior_samples, values_at
from vtlib.qfunctions import MLP

Q, PAIRS = MLP((1, 2)), 2000  # whose values at zero are its biases, the last two weights
LAWS = NormalDist(), NormalDist(0, 2), NormalDist(0, 0.5), NormalDist(1.5, 1)  # of each run's truth


def test_shares_are_those_of_the_normal_distribution():
    g, runs = torch.Generator().manual_seed(0), len(LAWS)
    # two components that differ, but not in the biases' means and deviations, which are one
    mu, factors = torch.tensor([[0.0, 0, 0, 9], [5, 0, 0, 9]]), torch.eye(4).repeat(2, 1, 1)
    factors[0, 2, [0, 2]] = factors[1, 3, [1, 3]] = torch.tensor([0.8, 0.6])
    noise = torch.randn(runs, 2, 500, 4, generator=g)
    samples = posterior_samples(mu.expand(runs, 2, 4), factors.expand(runs, 2, 4, 4), noise)
    drawn = mu.unsqueeze(1) + torch.einsum("cij,rckj->rcki", factors, noise)
    torch.testing.assert_close(samples, drawn.flatten(1, 2))
    action = torch.randint(2, (runs, PAIRS), generator=g)
    shift, spread = torch.tensor([(x.mean, x.stdev) for x in LAWS]).unsqueeze(2).unbind(1)
    truth = mu[0, 2 + action] + shift + spread * torch.randn(3, runs, PAIRS, generator=g)
    found = inside(values_at(Q, samples, torch.zeros(runs, PAIRS, 1), action), truth)
    ends = [NormalDist().inv_cdf((1 + x) / 2) for x in LEVELS]
    expected = [[law.cdf(z) - law.cdf(-z) for z in ends] for law in LAWS]
    # three standard errors of 2,000 pairs, and as much for the 1,000 samples' quantiles
    np.testing.assert_allclose(found, [expected] * 3, atol=0.065)
