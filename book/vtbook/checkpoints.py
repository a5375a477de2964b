"""Runs that are halted at some iterations, to look at what they have learned by then."""

from collections.abc import Iterator, Sequence
from itertools import islice

from vtlab.run import Batch
from vtlib.training import iterate


def pauses(batch: Batch, at: Sequence[int]) -> Iterator[int]:
    """Each of some iterations, once a batch's runs have come to it; 0 is before the first."""
    if 0 in at:
        yield 0
    for t in islice(iterate(batch.agent, batch.episodes), max(at)):
        if t in at:
            yield t
