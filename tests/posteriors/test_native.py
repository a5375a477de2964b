"""The posteriors in C++: they equal the plain update, whatever happens in a block of iterations."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from vtlib import posteriors
from vtlib.posteriors import COVARIANCES, MANY, Descent
from vtlib.posteriors.blocked import DRAWS, Blocked
from vtlib.posteriors.dense import Dense
from vtlib.posteriors.fused import Fused
from vtlib.posteriors.native import MOST_SAMPLES
from vtlib.priors import GaussianPrior, Precision, Start
from vtlib.rng import Stream

SIDE = 32  # of the kernel's squares
PULL = 0.02
either = pytest.mark.parametrize("kind", [Fused, Blocked])


def draw(*shape: int, seed: int) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def both(kind, d, samples, descent, members=(1, 1)) -> tuple[Fused | Blocked, Dense]:
    """The same posterior by a kernel and plainly."""
    runs, precision = members[0], Precision(5.0)
    if members[1] == 1 and (kind is Fused or descent.kl == "diagonal"):
        precision = GaussianPrior(draw(runs, 4, d, seed=7), 0.2).precision
    spread = 0.4 * draw(runs, d, 3, seed=2) if d % 3 else None
    start = Start(draw(*members, d, seed=1), 0.3, spread)
    streams = (Stream("t", range(runs), "posterior") for _ in range(2))
    return tuple(k(start, precision, descent, next(streams), samples) for k in (kind, Dense))


def assert_close(ours: Tensor, plain: Tensor) -> Tensor:
    """Up to rounding; the plain ones are returned."""
    torch.testing.assert_close(ours, plain, rtol=0, atol=2e-5 * plain.abs().max().item())
    return plain


def step(pair, gradients: Tensor, pull: float = PULL) -> None:
    for each in pair:
        each.step(gradients, pull)


# the same examples each time: in a hundred steps rounding can grow beyond the tolerance
@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    st.sampled_from([Fused, Blocked]),
    st.integers(1, 3 * SIDE + 5) | st.just(200),
    st.integers(2, MOST_SAMPLES),
    st.tuples(st.integers(1, 2), st.integers(1, 3)),
    st.sampled_from(["full", "diagonal"]),
    st.sampled_from([None, 0.3, 1.0, 1000.0]),
    st.sampled_from([None, 2.0, 100.0]),
    st.sampled_from([1e-4, 0.1, 0.5]),
    st.sampled_from([0.02, 1.0]),
    # what is left of a factor: 1 - 5 alpha of it, most, a quarter, or less than nothing
    st.sampled_from([0.1, 3.0, 5.0, 9.0]),
    st.integers(1, MOST_SAMPLES),
)
def test_whatever_happens_in_a_block_equals_the_plain_update(
    kind, d, samples, members, kl, clip, kl_clip, sigma_min, pull, strong, used
):
    pair = both(kind, d, samples, Descent(0.05, sigma_min, clip, kl, kl_clip), members)
    # two blocks and the beginning of the next
    for t in range(2 * (DRAWS // samples) + 2):
        plain = assert_close(*(each.sample() for each in pair))[:, :, -used:]
        gradients = 0.02 * (0.2 * plain + draw(*plain.shape, seed=t))
        if t % 13 in (3, 4):
            gradients[:, -1] *= 30  # the others are left alone
        step(pair, gradients, strong if t % 17 == 9 else pull)
        if t % 5 == 1:
            step(pair, draw(*plain.shape, seed=t))  # without samples between
        if t % 7 == 3:
            assert_close(*(each.sample() for each in pair))  # with which no step is made
    ours, plain = (each.scale_tril for each in pair)
    assert_close(ours, plain)
    assert torch.equal(ours, ours.tril())


@either
def test_looking_at_the_factors_changes_nothing(kind):
    looked, alone = (both(kind, 2 * SIDE + 3, 11, Descent(0.02, 1e-3))[0] for _ in range(2))
    for t in range(DRAWS // 11 + 3):
        assert torch.equal(looked.sample(), alone.sample())
        step((looked, alone), draw(1, 1, 10, 2 * SIDE + 3, seed=t), 0.1)
        assert torch.equal(looked.scale_tril, looked.scale_tril)
    assert torch.equal(looked.scale_tril, alone.scale_tril)


@either
def test_weights_that_are_not_finite_stay_so(kind):
    ours, _ = both(kind, 100, 3, Descent(0.05, 0.1, 1000.0))
    for t in range(DRAWS):
        ours.sample()
        gradients = torch.zeros(1, 1, 2, 100)
        gradients[..., 70] = torch.nan if t == 5 else 0.0
        ours.step(gradients, PULL)
    assert ours.sample()[..., 70].isnan().all()


def test_memory_is_modest():
    assert MANY < 1890
    assert both(Blocked, 1890, 11, Descent(1e-6, 1e-4))[0]._memory.nbytes < 12e6


@pytest.mark.parametrize(
    ("d", "n_samples", "kl", "low_rank", "kind"),
    [
        (MANY - 1, MOST_SAMPLES, "full", False, Fused),
        (MANY, MOST_SAMPLES, "full", False, Blocked),
        (MANY, 2, "full", True, Fused),
        (MANY, 2, "diagonal", True, Blocked),
        (MANY, MOST_SAMPLES + 1, "full", False, Dense),
    ],
)
def test_a_full_covariance_is_updated_by_the_kernel_that_suits_it(
    monkeypatch, d, n_samples, kl, low_rank, kind
):
    start, stream = Start(torch.zeros(1, 1, d), 1.0), Stream("t", [0], "posterior")
    precision = Precision(1.0, torch.zeros(1, d, 2) if low_rank else None)
    arguments = start, precision, Descent(0.1, 1e-4, kl=kl), stream, n_samples
    assert type(COVARIANCES["full"](*arguments)) is kind
    monkeypatch.setattr(posteriors, "kernels", lambda: None)
    assert type(COVARIANCES["full"](*arguments)) is Dense
