"""The drifting prior: its weights, its start, and its pull against autograd of the density."""

import math

import pytest
import torch

from vtbook.neighbours import DriftingSettings
from vtbook.neighbours.drifting import DriftingPrior
from vtlib.qfunctions import MLP
from vtlib.rng import Rng

Q = MLP((1, 2))
SOURCES = torch.randn(2, 4, Q.d, generator=torch.Generator().manual_seed(0))
MU = torch.randn(2, 1, Q.d, generator=torch.Generator().manual_seed(1))


def test_weights_are_the_kernels_of_the_sources_ages_and_variational_transfer_starts_by_them():
    kernel = torch.tensor([math.exp(-(age**2) / (2 * 1.5**2)) for age in (4, 3, 2, 1)])
    settings = DriftingSettings(bandwidth=1.5, sigma_p2=0.1, responsibilities="equal")
    prior = settings.prior(SOURCES)
    torch.testing.assert_close(prior.log_weights.exp(), kernel / kernel.sum())
    mean = (kernel.view(-1, 1) * SOURCES).sum(1, keepdim=True) / kernel.sum()
    torch.testing.assert_close(prior.pull(MU), (MU - mean) / 0.1)
    for init, start in (("mean", mean), ("sources", SOURCES[:, -1:])):
        agent = DriftingSettings(bandwidth=1.5, init=init).agent(Q, SOURCES, 1, Rng("t", range(2)))
        torch.testing.assert_close(agent.mu, start)


@pytest.mark.parametrize("variance", [0.5, 5.0])
def test_the_pull_is_the_gradient_of_the_log_density(variance):
    prior, w = DriftingPrior(SOURCES, variance, bandwidth=2.0), MU.clone().requires_grad_()
    squares = (w - SOURCES).square().sum(-1) / (2 * variance)
    (-torch.logsumexp(prior.log_weights - squares, -1).sum()).backward()
    torch.testing.assert_close(prior.pull(MU), w.grad)


@pytest.mark.parametrize(("field", "value"), [("components", 2), ("family", "gaussian")])
def test_it_takes_one_component_of_a_mixture_alone(field, value):
    with pytest.raises(ValueError, match=field):
        DriftingSettings(**{field: value})
