"""The drifting prior: its weights, its start, and its pull against autograd of the density."""

from __future__ import annotations

import math

import pytest
import torch

from vtbook.neighbours import DriftingSettings
from vtbook.neighbours.drifting import DriftingPrior
from vtlib.priors import MixturePrior
from vtlib.qfunctions import MLP
from vtlib.rng import Rng

SOURCES = torch.randn(2, 4, 5, generator=torch.Generator().manual_seed(0))


def test_weights_are_the_kernels_of_the_sources_ages():
    prior = DriftingPrior(SOURCES, 0.1, bandwidth=1.5)
    kernel = [math.exp(-(age**2) / (2 * 1.5**2)) for age in (4, 3, 2, 1)]
    expected = torch.tensor(kernel) / sum(kernel)
    torch.testing.assert_close(prior.log_weights.exp(), expected)
    mean = (expected.view(-1, 1) * SOURCES).sum(1, keepdim=True)
    torch.testing.assert_close(prior.start(1, "mean").mu, mean)
    torch.testing.assert_close(prior.start(1, "sources").mu, SOURCES[:, -1:])


@pytest.mark.parametrize("variance", [0.5, 5.0])
def test_the_pull_is_the_gradient_of_the_log_density(variance):
    prior = DriftingPrior(SOURCES, variance, bandwidth=2.0)
    w = torch.randn(2, 1, 5, generator=torch.Generator().manual_seed(1)).requires_grad_()
    squares = (w - SOURCES).square().sum(-1) / (2 * variance)
    (-torch.logsumexp(prior.log_weights - squares, -1).sum()).backward()
    torch.testing.assert_close(prior.pull(w.detach()), w.grad)


@pytest.mark.parametrize("kind", ["exact", "equal"])
def test_a_kernel_without_end_makes_it_the_mixture_of_equals(kind):
    ours, equal = DriftingPrior(SOURCES, 0.5, 1e4, kind), MixturePrior(SOURCES, 0.5, kind)
    mu = SOURCES.mean(1, keepdim=True) + 0.3
    torch.testing.assert_close(ours.pull(mu), equal.pull(mu), rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(ours.start(1, "mean").mu, equal.start(1, "mean").mu)


def test_it_runs_as_variational_transfer_and_takes_one_component_alone():
    q = MLP((1, 2))
    sources = torch.randn(3, 4, q.d, generator=torch.Generator().manual_seed(2))
    agent = DriftingSettings(init="sources").agent(q, sources, 1, Rng("t", range(3)))
    torch.testing.assert_close(agent.mu, sources[:, -1:])
    for wrong in ({"components": 2}, {"family": "gaussian"}, {"bandwidth": 0.0}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            DriftingSettings(**wrong)
