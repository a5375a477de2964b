"""Comparisons of runs against their definitions, and their intervals' coverage by simulation."""

import math
from functools import partial

import numpy as np
import pytest
from scipy.stats import t as student

from vtbook.comparisons import (
    holm,
    paired_p,
    ratio_interval,
    slope_interval,
    spread_interval,
)


def rng(seed=0):
    return np.random.default_rng(seed)


def test_runs_that_do_not_pair_are_refused():
    for call in (slope_interval, ratio_interval, paired_p, partial(spread_interval, rng=rng())):
        with pytest.raises(ValueError, match="must pair"):
            call(range(20), range(19))


def test_the_slope_is_that_of_least_squares_and_its_interval_students():
    x = np.linspace(0, 4, 20)
    y = 1.0 - 0.2 * x + rng().normal(0, 0.3, 20)
    (slope, _), covariance = np.polyfit(x, y, 1, cov=True)
    half = 2.1009 * covariance[0, 0] ** 0.5  # of 18 degrees of freedom
    assert slope_interval(x, y) == pytest.approx((slope, slope - half, slope + half), rel=1e-4)


def test_a_ratio_of_means_feels_only_what_its_pairs_do_not_share():
    b = np.array([1.0, 2.0, 3.0, 6.0])
    assert ratio_interval(0.5 * b, b) == pytest.approx((0.5, 0.5, 0.5))
    # by hand: means 3 and 3, residuals a - b of 2, 0, 0 and -2
    a = b + np.array([2.0, 0, 0, -2.0])
    half = 3.1824 * math.sqrt(8 / 3) / 2 / 3
    assert ratio_interval(a, b) == pytest.approx((1, 1 - half, 1 + half), rel=1e-4)
    assert ratio_interval(-a, -b) == pytest.approx(ratio_interval(a, b))


def test_a_ratio_of_deviations_is_that_of_the_runs_and_resamples_them_in_pairs():
    a, b = rng().standard_normal((2, 20))
    assert spread_interval(7 - 3 * b, b, rng(), 50) == pytest.approx((3, 3, 3))
    found = spread_interval(a, b, rng())
    assert found.centre == pytest.approx(np.std(a, ddof=1) / np.std(b, ddof=1))
    assert found.low < found.centre < found.high
    # runs of which almost all are alike: resamples without the odd one have no ratio
    odd = np.array([1.0, 0, 0, 0])
    assert spread_interval(odd, odd, rng()) == pytest.approx((1, 1, 1))


def test_holms_p_values_are_those_of_its_steps():
    # 4 * .005, 3 * .01, 2 * .03, and .04, which must not be less than the one before
    np.testing.assert_allclose(holm(np.array([0.01, 0.04, 0.03, 0.005])), [0.03, 0.06, 0.06, 0.02])
    np.testing.assert_allclose(holm(np.array([0.9, 0.6])), [1.0, 1.0])


def test_paired_runs_are_tested_by_their_differences():
    base, shift = rng(1).normal(0, 100, 30), rng(2).normal(0.5, 1, 30)
    t = shift.mean() / (shift.std(ddof=1) / 30**0.5)
    assert paired_p(base + shift, base) == pytest.approx(2 * student.sf(abs(t), 29), rel=1e-6)


def test_an_interval_of_a_ratio_of_deviations_covers_it():
    g, covered = rng(3), []
    for _ in range(200):
        shared, own = g.standard_normal((2, 20))  # pairs share half of their variance
        _, low, high = spread_interval(2 * (shared + own) / math.sqrt(2), shared, g, 200)
        covered.append(low <= 2.0 <= high)
    # standard error 0.02; a percentile bootstrap of twenty pairs is a little short
    assert 0.86 < np.mean(covered) < 0.985
