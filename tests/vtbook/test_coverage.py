"""Coverage: closed forms, a calibrated posterior, and one that is too sure of itself."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
import pytest
import torch

from vtbook.coverage import LEVELS, inside, posterior_samples, values_at

RUNS, PAIRS, SAMPLES = 2, 2000, 1000


class Bandit:
    """Two actions, one state: Q is the weights themselves."""

    n_actions = width = d = 2

    def prepare(self, obs: torch.Tensor) -> torch.Tensor:
        return obs

    def q(self, w: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        return w.unsqueeze(-1).expand(*w.shape, x.shape[1])


def drawn(spread: float, shift: float = 0.0) -> torch.Tensor:
    """Shares for truths N(shift, spread^2) around a posterior N(0, 1) of both weights."""
    g = torch.Generator().manual_seed(0)
    mu, scale_tril = torch.zeros(RUNS, 1, 2), torch.eye(2).expand(RUNS, 1, 2, 2)
    noise = torch.randn(RUNS, 1, SAMPLES, 2, generator=g)
    truth = shift + spread * torch.randn(3, RUNS, PAIRS, generator=g)
    action = torch.randint(2, (RUNS, PAIRS), generator=g)
    obs = torch.zeros(RUNS, PAIRS, 1)
    return inside(values_at(Bandit(), posterior_samples(mu, scale_tril, noise), obs, action), truth)


@pytest.mark.parametrize(("spread", "shift"), [(1.0, 0.0), (2.0, 0.0), (0.5, 0.0), (1.0, 1.5)])
def test_shares_are_those_of_the_normal_distribution(spread, shift):
    ends = [NormalDist().inv_cdf((1 + level) / 2) for level in LEVELS]
    truth = NormalDist(shift, spread)
    expected = [truth.cdf(z) - truth.cdf(-z) for z in ends]
    # three standard errors of 2,000 pairs, and as much for the 1,000 samples' quantiles
    np.testing.assert_allclose(drawn(spread, shift).numpy(), [[expected] * RUNS] * 3, atol=0.065)


def test_samples_have_the_mixtures_mean_and_covariance():
    g = torch.Generator().manual_seed(1)
    mu = torch.tensor([[[1.0, -1.0], [3.0, 0.0]]])
    scale_tril = torch.tensor([[[[0.5, 0.0], [1.0, 0.2]], [[0.1, 0.0], [0.0, 2.0]]]])
    weights = posterior_samples(mu, scale_tril, torch.randn(1, 2, 20_000, 2, generator=g))
    for c, part in enumerate(weights[0].split(20_000)):
        torch.testing.assert_close(part.mean(0), mu[0, c], rtol=0, atol=0.05)
        torch.testing.assert_close(
            torch.cov(part.T), scale_tril[0, c] @ scale_tril[0, c].T, rtol=0, atol=0.1
        )


def test_a_value_is_looked_up_by_its_action():
    mu, scale_tril = torch.tensor([[[0.0, 9.0]]]), 0.1 * torch.eye(2).view(1, 1, 2, 2)
    noise = torch.randn(1, 1, 100, 2, generator=torch.Generator().manual_seed(2))
    weights = posterior_samples(mu, scale_tril, noise)
    action, truth = torch.tensor([[0, 1]]), torch.tensor([[0.0, 9.0]])
    obs = torch.zeros(1, 2, 1)
    assert (inside(values_at(Bandit(), weights, obs, action), truth) == 1).all()
    assert (inside(values_at(Bandit(), weights, obs, 1 - action), truth) == 0).all()
