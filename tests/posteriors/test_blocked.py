"""Large factors in blocks of iterations: they equal the plain update, whatever a block meets."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from vtlib.posteriors import MANY, Descent
from vtlib.posteriors.blocked import DRAWS, Blocked
from vtlib.posteriors.dense import Dense
from vtlib.posteriors.native import MOST_SAMPLES
from vtlib.priors import Precision, Start, low_rank_precision, sources_mean_and_spread
from vtlib.rng import Stream

SIDE = 32  # of the kernel's squares
PULL = 0.02


def draw(*shape: int, seed: int) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def both(
    d: int, samples: int, descent: Descent, runs: int = 1, components: int = 1, spread: bool = True
) -> tuple[Blocked, Dense]:
    """The same posterior by blocks and plainly."""
    precision = Precision(5.0)
    if descent.kl == "diagonal" and components == 1:
        precision = low_rank_precision(sources_mean_and_spread(draw(runs, 4, d, seed=7))[1], 0.2)
    start = Start(draw(runs, components, d, seed=1), 0.3, 0.4 * draw(runs, d, 3, seed=2))
    start = start if spread else start._replace(spread=None)
    return tuple(
        kind(start, precision, descent, Stream("t", range(runs), "posterior"), samples)
        for kind in (Blocked, Dense)
    )


def advance(pair: tuple[Blocked, Dense], t: int, used: int, scale: float, pull: float) -> None:
    """An iteration of both, whose samples must be equal up to rounding."""
    ours, plain = (each.sample() for each in pair)
    close = 2e-5 * plain.abs().max().item()
    torch.testing.assert_close(ours, plain, rtol=0, atol=close)
    shape = *plain.shape[:2], used, plain.shape[3]
    gradients = scale * (0.2 * plain[:, :, -used:] + draw(*shape, seed=1000 + t))
    for each in pair:
        each.step(gradients, pull)


def assert_equal_factors(pair: tuple[Blocked, Dense]) -> None:
    ours, plain = (each.scale_tril for each in pair)
    torch.testing.assert_close(ours, plain, rtol=0, atol=2e-5 * plain.abs().max().item())
    assert torch.equal(ours, ours.tril())


@settings(max_examples=40, deadline=None)
@given(
    st.integers(1, 3 * SIDE + 5),
    st.integers(2, MOST_SAMPLES),
    st.tuples(st.integers(1, 2), st.integers(1, 3)),
    st.booleans(),
    st.sampled_from(["full", "diagonal"]),
    st.sampled_from([None, 0.3, 1.0, 1000.0]),
    st.sampled_from([None, 2.0, 100.0]),
    st.sampled_from([1e-4, 0.5]),
    st.sampled_from([0.02, 1.0]),
    st.integers(1, MOST_SAMPLES),
)
def test_any_shape_equals_the_plain_update(
    d, samples, members, spread, kl, clip, kl_clip, sigma_min, pull, used
):
    pair = both(d, samples, Descent(0.05, sigma_min, clip, kl, kl_clip), *members, spread)
    # a block and the beginning of the next
    for t in range(DRAWS // samples + 2):
        advance(pair, t, min(used, samples), 0.05, pull)
    assert_equal_factors(pair)


@pytest.mark.parametrize("samples", [2, 6, 11, 16])
@pytest.mark.parametrize("kl", ["full", "diagonal"])
def test_many_blocks_equal_the_plain_update(samples, kl):
    pair = both(200, samples, Descent(0.02, 0.3, 1000.0, kl), 2, 2)
    for t in range(110):
        advance(pair, t, samples - 1, 0.02, PULL)
    assert_equal_factors(pair)


def test_a_member_is_clipped_alone_and_within_a_block():
    pair = both(2 * SIDE, 11, Descent(0.02, 1e-3, 1.0), 1, 2)
    plain = pair[1]
    clipped = 0
    for t in range(40):
        samples = [each.sample() for each in pair]
        gradients = 0.01 * draw(1, 2, 10, 2 * SIDE, seed=t)
        if t in (3, 4, 15, 16, 30):  # the first is left alone
            gradients[:, 1] *= 30
        before = plain.scale_tril.clone()
        for each in pair:
            each.step(gradients, PULL)
        # a step of alpha times the clip, below the diagonal
        most = (plain.scale_tril - before).tril(-1).abs().amax((0, 2, 3))
        clipped += int((most > 0.02 * 0.999).sum())
        assert most[0] < 0.02 * 0.999
        torch.testing.assert_close(*samples, rtol=0, atol=1e-4)
        assert_equal_factors(pair)
    assert clipped == 5


def test_looking_at_the_factors_changes_nothing():
    looked, alone = (both(2 * SIDE + 3, 11, Descent(0.02, 1e-3))[0] for _ in range(2))
    for t in range(DRAWS // 11 + 3):
        assert torch.equal(looked.sample(), alone.sample())
        for each in (looked, alone):
            each.step(draw(1, 1, 10, 2 * SIDE + 3, seed=t), 0.1)
        assert torch.equal(looked.scale_tril, looked.scale_tril)
    assert torch.equal(looked.scale_tril, alone.scale_tril)


def test_steps_may_follow_upon_each_other_or_stay_out():
    pair = both(100, 4, Descent(0.01, 1e-3, 1000.0))
    for t in range(60):
        advance(pair, t, 3, 0.1, PULL)
        if t % 5 == 1:
            for each in pair:
                each.step(draw(1, 1, 3, 100, seed=t), PULL)
        if t % 7 == 3:
            torch.testing.assert_close(*(each.sample() for each in pair), rtol=0, atol=1e-4)
    assert_equal_factors(pair)


@pytest.mark.parametrize("pull", [0.1, 3.0, 5.0, 9.0])
def test_a_pull_may_shrink_the_factor_to_little_or_turn_it_over(pull):
    # by 1 - alpha 5 pull: most of it stays, a quarter, less than nothing
    pair = both(100, 3, Descent(0.05, 0.1, None))
    for t in range(40):
        advance(pair, t, 2, 0.1, pull if t % 4 == 0 else PULL)
    assert_equal_factors(pair)


def test_weights_that_are_not_finite_stay_so():
    ours, _ = both(100, 3, Descent(0.05, 0.1, 1000.0))
    for t in range(DRAWS):
        ours.sample()
        gradients = draw(1, 1, 2, 100, seed=t)
        gradients[..., 70] = torch.nan if t == 5 else 0.0
        ours.step(gradients, PULL)
    assert ours.sample()[..., 70].isnan().all()


def test_memory_is_modest():
    wide = both(1891, 11, Descent(1e-6, 1e-4), spread=False)[0]
    assert wide._memory.nbytes < 12e6
    assert MANY < 1891
