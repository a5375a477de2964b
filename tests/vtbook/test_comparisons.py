"""Comparisons of runs against their definitions, and their intervals' coverage by simulation."""

import math
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import t as student

from vtbook.comparisons import (
    bootstrap_interval,
    holm,
    improvement_interval,
    interquartile_mean,
    paired_p,
    ratio_interval,
    slope_interval,
    spread_interval,
)

TASKS = np.repeat(np.arange(4), 5)
BETTER = 0.5 * (1 + math.erf(0.4))  # the chance of a normal run that is shifted by 0.8


def rng(seed=0):
    return np.random.default_rng(seed)


def runs(g):
    """Five runs of each task, which differ by ten."""
    return 10.0 * TASKS + g.standard_normal(20)


def test_runs_that_do_not_pair_or_fit_their_strata_are_refused():
    drawn = [partial(f, rng=rng()) for f in (spread_interval, improvement_interval)]
    for call in (slope_interval, ratio_interval, paired_p, *drawn):
        with pytest.raises(ValueError, match="must pair"):
            call(range(20), range(19))
    for strata in (TASKS[:5], TASKS.reshape(4, 5), np.arange(20)):
        for call in (bootstrap_interval, partial(improvement_interval, TASKS)):
            with pytest.raises(ValueError, match=r"as many strata|two or more"):
                call(TASKS, rng(), strata)


def test_the_slope_is_that_of_least_squares_and_its_interval_students():
    x = np.linspace(0, 4, 20)
    y = 1.0 - 0.2 * x + rng().normal(0, 0.3, 20)
    (slope, _), covariance = np.polyfit(x, y, 1, cov=True)
    half = 2.1009 * covariance[0, 0] ** 0.5  # of 18 degrees of freedom
    assert slope_interval(x, y) == pytest.approx((slope, slope - half, slope + half), rel=1e-4)
    for x in ([1, 2], [1, 1, 1], [[1, 2]] * 3):
        with pytest.raises(ValueError, match="at least 3 runs at different places"):
            slope_interval(x, x)


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


def test_the_probability_of_improvement_counts_pairs_of_a_task():
    tasks, a, b = np.array([[0, 1, 0, 1, 1], [1, 9, 2, 9, 9], [0, 9, 1, 9, 9]])
    # task 0: three wins and a tie in four pairs; task 1: nine ties
    expected = (3.5 / 4 + 0.5) / 2
    assert improvement_interval(a, b, rng(), tasks, 50).centre == pytest.approx(expected)


@settings(deadline=None, derandomize=True)
@given(st.lists(st.floats(-100, 100), min_size=1, max_size=23))
def test_the_interquartile_mean_is_that_of_the_middle_half_of_four_copies(values):
    expected = math.fsum(sorted(values * 4)[len(values) : 3 * len(values)]) / (2 * len(values))
    columns = interquartile_mean(np.stack([values, np.negative(values)], 1))
    np.testing.assert_allclose(columns, [expected, -expected], atol=1e-9)


def test_holms_p_values_are_those_of_its_steps():
    # 4 * .005, 3 * .01, 2 * .03, and .04, which must not be less than the one before
    np.testing.assert_allclose(holm(np.array([0.01, 0.04, 0.03, 0.005])), [0.03, 0.06, 0.06, 0.02])
    np.testing.assert_allclose(holm(np.array([0.9, 0.6])), [1.0, 1.0])
    # a false finding among twenty is as rare as its level: by independence
    # 1 - (1 - .05 / 20)^20 = .0488, within three standard errors
    false = [(holm(p) < 0.05).any() for p in rng().random((2000, 20))]
    assert abs(np.mean(false) - 0.0488) < 3 * (0.0488 / 2000) ** 0.5


def test_paired_runs_are_tested_by_their_differences():
    base, shift = rng(1).normal(0, 100, 30), rng(2).normal(0.5, 1, 30)
    t = shift.mean() / (shift.std(ddof=1) / 30**0.5)
    assert paired_p(base + shift, base) == pytest.approx(2 * student.sf(abs(t), 29), rel=1e-6)


def test_the_bootstrap_resamples_whole_runs_of_each_task_with_its_generator():
    values = rng().random((10, 1)) * np.ones(5)
    one, same, other = (bootstrap_interval(values, rng(seed), draws=50) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one.low, other.low)
    np.testing.assert_array_equal(one.centre, interquartile_mean(values))
    assert all(np.ptp(end) < 1e-12 for end in one)
    assert one.low[0] < one.centre[0] < one.high[0]
    # nor does it count what tasks differ by
    mine, pooled = (bootstrap_interval(runs(rng(2)), rng(), tasks, 500) for tasks in (TASKS, None))
    assert mine.high - mine.low < 0.2 * (pooled.high - pooled.low)


def pair(g):
    """Pairs that share half of their variance; the ratio of their deviations is 2."""
    shared, own = g.standard_normal((2, 20))
    return 3 + 2 * (shared + own) / math.sqrt(2), 5 + shared


# Standard errors up to 0.02. A percentile bootstrap of twenty pairs is a little short, and strata
# of five runs make the interval too short by sqrt(4/5): 0.92 instead of 0.95.
@pytest.mark.parametrize(
    ("find", "truth", "least", "most"),
    [
        (lambda g: ratio_interval(*pair(g)), 0.6, 0.92, 0.985),
        (lambda g: spread_interval(*pair(g), g, 200), 2.0, 0.86, 0.985),
        # the middle half of the pooled runs is that of tasks 1 and 2
        (lambda g: bootstrap_interval(runs(g), g, TASKS, 200), 15.0, 0.85, 0.97),
        (lambda g: improvement_interval(0.8 + runs(g), runs(g), g, TASKS, 200), BETTER, 0.86, 0.98),
    ],
)
def test_intervals_cover_what_they_estimate(find, truth, least, most):
    g = rng(3)
    found = [find(g) for _ in range(200)]
    assert least < np.mean([low <= truth <= high for _, low, high in found]) < most
