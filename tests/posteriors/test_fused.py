"""The posterior in C++: its steps wait for the next samples, and looking at it changes nothing."""

from __future__ import annotations

import pytest
import torch

from vtlib import native, posteriors
from vtlib.posteriors import COVARIANCES, MANY, Descent
from vtlib.posteriors.blocked import Blocked
from vtlib.posteriors.dense import Dense
from vtlib.posteriors.fused import Fused
from vtlib.posteriors.native import MOST_SAMPLES
from vtlib.priors import GaussianPrior, Precision, Start
from vtlib.rng import Stream

RUNS, D = 2, 21


def made(kind: type) -> Fused | Dense:
    sources = torch.randn(RUNS, 4, D, generator=torch.Generator().manual_seed(1))
    prior, stream = GaussianPrior(sources, 0.2), Stream("t", range(RUNS), "posterior")
    return kind(prior.start(1, "sources"), prior.precision, Descent(0.01, 1e-3), stream, 4)


def gradients(t: int) -> torch.Tensor:
    return torch.randn(RUNS, 1, 3, D, generator=torch.Generator().manual_seed(t))


def test_looking_at_the_factors_changes_nothing():
    looked, alone = made(Fused), made(Fused)
    for t in range(5):
        assert torch.equal(looked.sample(), alone.sample())
        for each in (looked, alone):
            each.step(gradients(t), 0.1)
        assert looked.scale_tril.shape == (RUNS, 1, D, D)
    assert torch.equal(looked.scale_tril, alone.scale_tril)


def test_two_steps_may_follow_upon_each_other():
    ours, plain = made(Fused), made(Dense)
    for each in (ours, plain):
        each.sample()
        for t in range(2):
            each.step(gradients(t), 0.1)
    torch.testing.assert_close(ours.scale_tril, plain.scale_tril, rtol=0, atol=1e-5)


@pytest.mark.parametrize(
    ("compiled", "d", "n_samples", "kl", "low_rank", "kind"),
    [
        (True, MANY - 1, MOST_SAMPLES, "full", False, Fused),
        (True, MANY, MOST_SAMPLES, "full", False, Blocked),
        (True, MANY, 2, "full", True, Fused),
        (True, MANY, 2, "diagonal", True, Blocked),
        (True, MANY, MOST_SAMPLES + 1, "full", False, Dense),
        (False, MANY, 2, "full", False, Dense),
    ],
)
def test_a_full_covariance_is_updated_by_the_kernel_that_suits_it(
    monkeypatch, compiled, d, n_samples, kl, low_rank, kind
):
    assert native.kernels() is not None  # else nothing here tests them
    if not compiled:
        monkeypatch.setattr(posteriors, "kernels", lambda: None)
    start, stream = Start(torch.zeros(1, 1, d), 1.0), Stream("t", [0], "posterior")
    precision = Precision(1.0, torch.zeros(1, d, 2) if low_rank else None)
    descent = Descent(0.1, 1e-4, kl=kl)
    assert type(COVARIANCES["full"](start, precision, descent, stream, n_samples)) is kind
