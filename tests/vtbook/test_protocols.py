"""Runs by the equations differ from the published ones in the method alone, on the same streams."""

import attrs
import numpy as np
import pytest

from vtbook.experiments.cartpole import CARTPOLE, CARTPOLE_EQUATIONS
from vtbook.experiments.rooms import ROOMS_EVALUATION, ROOMS_EVALUATION_EQUATIONS
from vtlab.run import chosen_sources, targets
from vtlib.transfer import Settings


def changed(a, b):
    """Fields in which two configurations of one class differ."""
    assert type(a) is type(b)
    return {x.name for x in attrs.fields(type(a)) if getattr(a, x.name) != getattr(b, x.name)}


@pytest.mark.parametrize(
    ("published", "equations", "of_pool"),
    [
        (ROOMS_EVALUATION, ROOMS_EVALUATION_EQUATIONS, {"family"}),
        (CARTPOLE, CARTPOLE_EQUATIONS, {"settings"}),
    ],
)
def test_protocols_share_streams_and_differ_in_the_method_alone(published, equations, of_pool):
    families = of_pool & {"family"}
    assert changed(published, equations) == {"name", "pool", "algorithms", "each"} | families
    assert (published.each, equations.each) == (True, False)
    assert changed(published.pool, equations.pool) == {"name"} | of_pool
    both, runs = (published, equations), range(published.runs)
    drawn = [(chosen_sources(e, runs), e.family.values(targets(e, runs))) for e in both]
    np.testing.assert_equal(*drawn)
    for label, algorithm in equations.algorithms.items():
        assert isinstance(algorithm, Settings) or algorithm == published.algorithms[label], label
