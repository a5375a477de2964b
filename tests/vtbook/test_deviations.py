"""The page of deviations: which runs it compares, and its rule for what counts as an effect."""

import numpy as np
import pytest

from vtlab.stats import Interval


@pytest.fixture
def page(cells_of):
    return cells_of("deviations")


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0.04, 0.08, "higher"),
        (-0.2, -0.1, "lower"),
        (0.01, 0.04, "no effect"),
        (-0.04, 0.04, "no effect"),
        (0.01, 0.06, "undecided"),
        (-0.06, 0.04, "undecided"),
    ],
)
def test_an_effect_counts_from_its_bound_on(page, low, high, expected):
    assert page["outcome"](Interval((low + high) / 2, low, high)) == expected


def test_an_effect_is_the_other_choice_minus_the_first_at_the_iterations_of_both(page):
    (pair, over, end), *_ = page["effects"]["First weights of networks"]
    other, first = (page["returns"](*one) for one in (pair.other, pair.first))
    shared = len(other.iteration)
    assert shared < len(first.iteration)
    gain = other.learning.values - first.learning.values[:, :shared]
    gain /= first.optimum.values[:, None]
    np.testing.assert_allclose([over.centre, end.centre], [gain.mean(), gain[:, -1].mean()], 1e-5)
