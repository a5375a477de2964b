"""Coverage: closed forms, a calibrated posterior, and one that is too sure of itself."""

from statistics import NormalDist

import numpy as np
import torch

from vtbook.coverage import LEVELS, inside, posterior_samples, values_at
from vtlib.qfunctions import MLP

Q, PAIRS = MLP((1, 2)), 2000  # whose values at zero are its biases, the last two weights
LAWS = NormalDist(), NormalDist(0, 2), NormalDist(0, 0.5), NormalDist(1.5, 1)  # of each run's truth


def test_shares_are_those_of_the_normal_distribution():
    g, runs = torch.Generator().manual_seed(0), len(LAWS)
    mu, scale_tril = torch.tensor([0.0, 0.0, 0.0, 9.0]), torch.eye(4).expand(runs, 1, 4, 4)
    noise = torch.randn(runs, 1, 1000, 4, generator=g)
    samples = posterior_samples(mu.expand(runs, 1, 4), scale_tril, noise)
    action = torch.randint(2, (runs, PAIRS), generator=g)
    shift, spread = torch.tensor([(x.mean, x.stdev) for x in LAWS]).unsqueeze(2).unbind(1)
    truth = mu[2 + action] + shift + spread * torch.randn(3, runs, PAIRS, generator=g)
    found = inside(values_at(Q, samples, torch.zeros(runs, PAIRS, 1), action), truth)
    ends = [NormalDist().inv_cdf((1 + x) / 2) for x in LEVELS]
    expected = [[law.cdf(z) - law.cdf(-z) for z in ends] for law in LAWS]
    # three standard errors of 2,000 pairs, and as much for the 1,000 samples' quantiles
    np.testing.assert_allclose(found, [expected] * 3, atol=0.065)


def test_samples_have_the_mixtures_mean_and_covariance():
    g = torch.Generator().manual_seed(1)
    mu = torch.tensor([[[1.0, -1.0], [3.0, 0.0]]])
    scale_tril = torch.tensor([[[[0.5, 0.0], [1.0, 0.2]], [[0.1, 0.0], [0.0, 2.0]]]])
    weights = posterior_samples(mu, scale_tril, torch.randn(1, 2, 20_000, 2, generator=g))
    for c, part in enumerate(weights[0].split(20_000)):
        torch.testing.assert_close(part.mean(0), mu[0, c], rtol=0, atol=0.05)
        covariance = scale_tril[0, c] @ scale_tril[0, c].T
        torch.testing.assert_close(part.T.cov(), covariance, rtol=0, atol=0.1)
