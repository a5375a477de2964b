"""A posterior with the prior's deviations, which never change; else it is a diagonal one."""

import torch

from vtlib.posteriors.base import Descent
from vtlib.posteriors.fixed import Fixed
from vtlib.priors import MixturePrior
from vtlib.rng import Stream


def test_a_step_changes_nothing():
    prior = MixturePrior(torch.randn(2, 4, 6), 0.01)
    noise = Stream("fixed", [0, 1], "x")
    fixed = Fixed(prior.start(1, "sources"), prior.precision, Descent(0.1, 1e-4), noise, 3)
    before = fixed.scale_tril
    fixed.sample()
    fixed.step(torch.ones(2, 1, 3, 6), 1.0)
    assert torch.equal(fixed.scale_tril, before)
