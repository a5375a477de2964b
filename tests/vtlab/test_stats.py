"""Intervals over runs against their definitions."""

import math

import numpy as np
import pytest

from vtlab.stats import difference_interval, mean_interval


def test_an_interval_is_students_with_one_degree_of_freedom_less():
    values = np.arange(20.0) - 9.5
    half = 2.0930 * values.std(ddof=1) / math.sqrt(20)
    assert mean_interval(values) == pytest.approx((0, -half, half), rel=5e-5)


@pytest.mark.parametrize(
    "call", [mean_interval, lambda x: difference_interval(np.zeros_like(x), x)]
)
def test_few_runs_and_values_that_are_not_finite_are_refused(call):
    for values in (np.array(1.0), np.zeros((0, 3)), [0.5]):
        with pytest.raises(ValueError, match="at least 2 runs, got shape"):
            call(values)
    for values in ([0, np.nan], [np.inf, 0], [0, -np.inf]):
        with pytest.raises(ValueError, match="finite values, got NaN"):
            call(values)
    with pytest.raises(ValueError, match="must pair"):
        difference_interval(range(20), range(19))


def test_a_paired_difference_is_not_widened_by_what_the_pairs_share():
    rng = np.random.default_rng(0)
    shared, own = 100 * rng.standard_normal(20), 0.5 + 0.01 * rng.standard_normal(20)
    np.testing.assert_allclose(difference_interval(shared + own, shared), mean_interval(own))
    single, half = np.full(4, 1 + 2**-20, dtype=np.float32), np.ones(4, dtype=np.float16)
    assert difference_interval(single, half).centre == 2**-20
