"""Variational transfer without its start: where it begins, and that its prior stays."""

import torch

from vtbook.neighbours import UnstartedSettings
from vtlib.priors import MixturePrior
from vtlib.qfunctions import MLP
from vtlib.rng import Rng


def test_it_starts_at_random_weights_and_is_pulled_to_its_sources():
    q, few = MLP((1, 20)), range(3)
    sources = 5 + torch.rand(3, 4, q.d, generator=torch.Generator().manual_seed(0))
    settings = UnstartedSettings(components=2, scale=0.5)
    mu = settings.agent(q, sources, 1, Rng("t", few)).mu
    assert mu.shape == (3, 2, q.d)
    assert abs(mu.std() - 0.5) < 0.1
    prior = settings.prior(torch.cat([mu, sources], 1))
    torch.testing.assert_close(prior.pull(mu), MixturePrior(sources, settings.sigma_p2).pull(mu))
