"""The two protocols differ in what they say they differ in, and share all random numbers."""

import attrs
import numpy as np
import pytest

from vtbook.experiments import rooms
from vtbook.experiments.cartpole import CARTPOLE
from vtlab.run import chosen_sources, targets
from vtlib.transfer import Settings

NAMES = ("EVALUATION", "CHANGE", "EXPLORATION", "LIKELIHOOD", "SOURCES")
ALL = [*(getattr(rooms, f"ROOMS_{name}") for name in NAMES), CARTPOLE]


def changed(a, b):
    """Fields in which two configurations of one class differ."""
    assert type(a) is type(b)
    return {x.name for x in attrs.fields(type(a)) if getattr(a, x.name) != getattr(b, x.name)}


@pytest.mark.parametrize("protocols", ALL, ids=lambda x: x.published.name)
def test_protocols_share_streams_and_differ_in_the_method_alone(protocols):
    published, equations = protocols
    assert equations.name == f"{published.name}-equations"
    # the published likelihoods are of doors half a unit apart, one fewer than were drawn
    own = {"runs"} if protocols is rooms.ROOMS_LIKELIHOOD else set()
    allowed = {"name", "pool", "family", "algorithms", "each", "counts"} | own
    assert changed(published, equations) <= allowed
    assert (published.each, equations.each) == (True, False)
    of_pool = "settings" if protocols is CARTPOLE else "family"
    assert changed(published.pool, equations.pool) == {"name", of_pool}
    if not own:
        runs = range(published.runs)
        drawn = [(chosen_sources(e, runs), e.family.values(targets(e, runs))) for e in protocols]
        np.testing.assert_equal(*drawn)
    for label, one in equations.algorithms.items():
        assert isinstance(one, Settings) or one == published.algorithms[label], label
