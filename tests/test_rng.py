"""Random streams: reproducible, independent of the batch, and distributed as they should be."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch
from scipy.stats import kstest
from torch import Tensor

from vtlib import rng
from vtlib.rng import Rng, Stream, generator


def take(stream: Stream, kind: str, draws: int, n: int) -> Tensor:
    """A number of draws (R, draws, n)."""
    return torch.stack([getattr(stream, kind)(n) for _ in range(draws)], 1)


@pytest.mark.parametrize("kind", ["normal", "uniform"])
@pytest.mark.parametrize("n", [1, 3, 500])
def test_numbers_depend_neither_on_the_batch_nor_on_how_many_are_drawn_ahead(kind, n, monkeypatch):
    together = take(Stream("e", range(5), "noise"), kind, 300, n)
    assert together.dtype == torch.float32
    for batch in ([3], [4, 3], [3, 100, 101]):
        some = take(Stream("e", batch, "noise"), kind, 300, n)
        assert torch.equal(some[batch.index(3)], together[3])
    for block in (1, 40, 1000):
        monkeypatch.setattr(rng, "BLOCK", block)
        assert torch.equal(take(Stream("e", range(5), "noise"), kind, 300, n), together)


def test_one_large_draw_holds_the_numbers_of_several_small_ones():
    # posteriors that draw their noise ahead have to meet the same noise
    small, large = (Stream("e", range(2), "noise") for _ in range(2))
    ahead = large.normal(24).view(2, 8, 3)
    assert torch.equal(take(small, "normal", 8, 3), ahead)


@pytest.mark.parametrize("before", [0, 7])
def test_some_runs_go_on_as_if_the_others_had_never_been(before):
    stream, alone = Stream("e", range(4), "noise"), Stream("e", [3, 1], "noise")
    for each in (stream, alone):
        take(each, "normal", before, 2) if before else None
    stream.keep([3, 1])
    assert len(stream) == 2
    assert torch.equal(take(stream, "normal", 300, 2), take(alone, "normal", 300, 2))


def test_equal_names_give_equal_numbers_and_other_names_others():
    names = [("e", 0, "noise"), ("e", 1, "noise"), ("e", 0, "replay"), ("f", 0, "noise")]
    first = [generator(*name).random(8) for name in names]
    for name, numbers in zip(names, first, strict=True):
        assert np.array_equal(generator(*name).random(8), numbers)
    for one, other in itertools.combinations(first, 2):
        assert not np.intersect1d(one, other).size


def test_numbers_are_the_same_on_every_machine():
    assert generator("e", 0, "noise").integers(1 << 32, size=2).tolist() == [2442650206, 441475362]


def test_rng_gives_each_role_its_stream_from_the_beginning():
    runs = Rng("e", [2, 0])
    assert len(runs) == len(runs.stream("noise")) == 2
    for _ in range(2):
        numbers = runs.stream("noise").uniform(3)
        assert torch.equal(numbers, Stream("e", [2, 0], "noise").uniform(3))
    runs.check_rows(2)
    with pytest.raises(ValueError, match="weights for each of 2 runs, got 3"):
        runs.check_rows(3)


@pytest.mark.parametrize(("kind", "cdf"), [("normal", "norm"), ("uniform", "uniform")])
def test_numbers_have_their_distribution(kind, cdf):
    x = take(Stream("e", range(2), "noise"), kind, 1000, 50).double().flatten()
    assert kstest(x, cdf).pvalue > 0.001
    assert x.unique().numel() > 0.99 * x.numel(), "draws do not repeat"
    assert kind == "normal" or 0 <= x.min() <= x.max() < 1
    first, second = take(Stream("e", range(2), "noise"), kind, 1, 20_000).double()[:, 0]
    # independent runs: N(0, 1 / 20,000), five standard deviations
    assert torch.corrcoef(torch.stack([first, second]))[0, 1].abs() < 5 / 20_000**0.5
    assert Stream("e", range(2), "noise").normal(0).shape == (2, 0)


@pytest.mark.parametrize("block", [1, rng.BLOCK])  # between two blocks, too
def test_another_kind_or_count_is_refused(block, monkeypatch):
    monkeypatch.setattr(rng, "BLOCK", block)
    stream = Stream("e", range(2), "noise")
    stream.normal(3)
    for draw, n in ((stream.normal, 4), (stream.uniform, 3)):
        with pytest.raises(ValueError, match=f"yields 3 normal numbers a draw, not {n} "):
            draw(n)
