"""A posterior with the prior's deviations: what it starts with, draws and never changes."""

import torch

from vtlib.posteriors.base import Descent
from vtlib.posteriors.diagonal import Diagonal
from vtlib.posteriors.fixed import Fixed
from vtlib.priors import GaussianPrior, MixturePrior
from vtlib.rng import Stream

SOURCES = torch.randn(2, 4, 6, generator=torch.Generator().manual_seed(0))


def made(kind, prior, components=1):
    start = prior.start(components, "sources")
    return kind(start, prior.precision, Descent(0.1, 1e-4), Stream("fixed", [0, 1], "x"), 3)


def test_it_starts_and_draws_as_a_diagonal_posterior_does():
    for prior, components in ((MixturePrior(SOURCES, 0.01), 2), (GaussianPrior(SOURCES), 1)):
        fixed, diagonal = (made(kind, prior, components) for kind in (Fixed, Diagonal))
        torch.testing.assert_close(fixed.scale_tril, diagonal.scale_tril)
        torch.testing.assert_close(fixed.sample(), diagonal.sample())


def test_a_step_changes_nothing():
    fixed = made(Fixed, MixturePrior(SOURCES, 0.01))
    before = fixed.scale_tril
    fixed.step(torch.ones(2, 1, 3, 6), 1.0)
    assert torch.equal(fixed.scale_tril, before)
