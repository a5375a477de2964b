"""Random streams: reproducible, and independent of the batch."""

import itertools

import numpy as np
import pytest
import torch

from vtlib import rng
from vtlib.rng import Stream, generator


def take(runs, kind, draws, n):
    """The first numbers of a stream (R, draws, n)."""
    stream = Stream("e", runs, "noise")
    return torch.stack([getattr(stream, kind)(n) for _ in range(draws)], 1)


@pytest.mark.parametrize("kind", ["normal", "uniform"])
@pytest.mark.parametrize("n", [1, 3, 500])
def test_numbers_depend_neither_on_the_batch_nor_on_how_many_are_drawn_ahead(kind, n, monkeypatch):
    together = take(range(5), kind, 300, n)
    assert together.dtype == torch.float32
    for batch in ([3], [4, 3], [3, 100, 101]):
        assert torch.equal(take(batch, kind, 300, n)[batch.index(3)], together[3])
    for block in (1, 40, 1000):
        monkeypatch.setattr(rng, "BLOCK", block)
        assert torch.equal(take(range(5), kind, 300, n), together)
    # posteriors that draw their noise ahead have to meet the same noise
    assert torch.equal(take(range(5), kind, 1, 8 * n).view(5, 8, n), together[:, :8])


@pytest.mark.parametrize("before", [0, 7])
def test_some_runs_go_on_as_if_the_others_had_never_been(before):
    stream, alone = Stream("e", range(4), "noise"), take([3, 1], "normal", 300, 2)
    for t in range(300):
        if t == before:
            stream.keep([3, 1])
        numbers = stream.normal(2)
        assert t < before or torch.equal(numbers, alone[:, t])


def test_equal_names_give_equal_numbers_and_other_names_others():
    names = [("e", 0, "noise"), ("e", 1, "noise"), ("e", 0, "replay"), ("f", 0, "noise")]
    for first, second in itertools.combinations([generator(*name).random(8) for name in names], 2):
        assert not np.intersect1d(first, second).size
    # the same on every machine
    assert generator(*names[0]).integers(1 << 32, size=2).tolist() == [2442650206, 441475362]
