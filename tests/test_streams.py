"""Random streams: reproducible, independent of the batch, and distributed as they should be."""

from __future__ import annotations

import itertools
from unittest import mock

import numpy as np
import pytest
import torch
from torch import Tensor

from vtlib import streams
from vtlib.streams import Stream, generator


def take(stream: Stream, kind: str, draws: int, n: int) -> Tensor:
    """A number of draws (R, draws, n)."""
    return torch.stack([getattr(stream, kind)(n) for _ in range(draws)], 1)


@pytest.mark.parametrize("kind", ["normal", "uniform"])
@pytest.mark.parametrize("n", [1, 3, 500])
def test_numbers_do_not_depend_on_the_batch_of_runs(kind, n):
    together = take(Stream("e", range(5), "noise"), kind, 300, n)
    assert together.dtype == torch.float32
    for batch in ([3], [4, 3], [3, 100, 101]):
        some = take(Stream("e", batch, "noise"), kind, 300, n)
        assert torch.equal(some[batch.index(3)], together[3])


@pytest.mark.parametrize("kind", ["normal", "uniform"])
@pytest.mark.parametrize("n", [1, 3])
def test_numbers_do_not_depend_on_how_many_are_drawn_ahead(kind, n):
    usual = take(Stream("e", range(4), "noise"), kind, 300, n)
    for block in (1, 40, 1000):
        with mock.patch.object(streams, "BLOCK", block):
            assert torch.equal(take(Stream("e", range(4), "noise"), kind, 300, n), usual)


def test_draws_do_not_repeat():
    numbers = take(Stream("e", range(2), "noise"), "uniform", 1000, 2)
    assert numbers.double().unique().numel() > 0.99 * numbers.numel()


def test_equal_names_give_equal_numbers_and_other_names_others():
    names = [("e", 0, "noise"), ("e", 1, "noise"), ("e", 0, "replay"), ("f", 0, "noise")]
    first = [generator(*name).random(8) for name in names]
    for name, numbers in zip(names, first, strict=True):
        assert np.array_equal(generator(*name).random(8), numbers)
    for one, other in itertools.combinations(first, 2):
        assert not np.intersect1d(one, other).size


def test_numbers_are_the_same_on_every_machine():
    assert generator("e", 0, "noise").integers(1 << 32, size=2).tolist() == [2442650206, 441475362]


def test_runs_and_roles_are_uncorrelated():
    size = 20_000
    rows = [
        take(Stream("e", range(3), role), "normal", 1, size)[:, 0] for role in ("noise", "replay")
    ]
    correlation = torch.corrcoef(torch.cat(rows).double())
    # each is N(0, 1 / size): five standard deviations
    assert (correlation - torch.eye(6)).abs().max() < 5 / size**0.5


def test_normal_numbers_are_standard_normal():
    x = take(Stream("e", range(2), "noise"), "normal", 100, 1000).double().flatten()
    root = len(x) ** 0.5
    assert x.mean().abs() < 5 / root
    assert (x.var() - 1).abs() < 5 * 2**0.5 / root
    assert ((x.abs() < 1).double().mean() - 0.6827).abs() < 5 * 0.47 / root


def test_uniform_numbers_fill_the_unit_interval():
    x = take(Stream("e", range(2), "noise"), "uniform", 100, 1000).double().flatten()
    assert x.min() >= 0
    assert x.max() < 1
    counts = torch.histc(x, 10, 0, 1)
    expected = len(x) / 10
    # chi-squared with 9 degrees of freedom: 27.9 has probability 0.001
    assert ((counts - expected).square() / expected).sum() < 27.9


def test_another_count_is_refused():
    stream = Stream("e", range(2), "noise")
    stream.normal(3)
    with pytest.raises(ValueError, match=r"yields 3 .*not 4"):
        stream.normal(4)


def test_another_count_is_refused_between_two_blocks():
    with mock.patch.object(streams, "BLOCK", 1):
        stream = Stream("e", range(2), "noise")
        stream.normal(3)
        with pytest.raises(ValueError, match=r"yields 3 .*not 4"):
            stream.normal(4)


def test_another_distribution_is_refused():
    stream = Stream("e", range(2), "noise")
    stream.normal(3)
    with pytest.raises(ValueError, match="normal"):
        stream.uniform(3)


def test_tasks_without_noise_draw_nothing():
    assert Stream("e", range(2), "noise").normal(0).shape == (2, 0)
