"""Intervals and robust means against their definitions, and their coverage by simulation."""

from __future__ import annotations

import math
from itertools import product

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
from vtlib.stats import difference_interval, mean_interval, same_distribution_p

PROPERTY = settings(deadline=None, derandomize=True)
TASKS = np.repeat(np.arange(4), 5)
LEVEL = 10.0 * TASKS  # what tasks differ by


@pytest.mark.parametrize(
    ("runs", "quantile"),
    [(2, 12.7062), (3, 4.3027), (10, 2.2622), (20, 2.0930), (31, 2.0423), (1000, 1.9623)],
)
def test_the_quantile_is_students_with_one_degree_of_freedom_less(runs, quantile):
    values = np.arange(runs, dtype=np.float64)
    interval = mean_interval(values)
    error = values.std(ddof=1) / math.sqrt(runs)
    assert interval.centre == values.mean()
    assert (interval.high - interval.centre) / error == pytest.approx(quantile, abs=1e-4)
    assert (interval.centre - interval.low) / error == pytest.approx(quantile, abs=1e-4)


def test_each_column_has_its_own_interval_in_double_precision():
    values = np.random.default_rng(0).standard_normal((7, 3, 4)).astype(np.float32)
    whole = mean_interval(values)
    assert whole.centre.shape == whole.low.shape == whole.high.shape == (3, 4)
    for i, j in np.ndindex(3, 4):
        alone = mean_interval(values[:, i, j].astype(np.float64))
        np.testing.assert_allclose([x[i, j] for x in whole], alone)
    assert mean_interval(np.array([1e8, 1, -1e8, 1], dtype=np.float32)).centre == 0.5


@pytest.mark.parametrize(
    "values",
    [np.array(1.0), np.zeros((0, 3)), [0.5], [[0, 1], [2, np.nan]], [np.inf, 0], [0, -np.inf]],
)
def test_few_runs_and_values_that_are_not_finite_have_no_interval(values):
    rng = np.random.default_rng(0)
    for call in (
        lambda: mean_interval(values),
        lambda: difference_interval(np.zeros_like(values), values),
        lambda: slope_interval(values, values),
        lambda: ratio_interval(values, values),
        lambda: spread_interval(values, values, rng),
        lambda: bootstrap_interval(values, rng),
        lambda: improvement_interval(values, values, rng),
        lambda: same_distribution_p(values, values, rng),
    ):
        with pytest.raises(ValueError, match=r"at least 2 runs, got shape|finite values, got NaN"):
            call()


@pytest.mark.parametrize("runs", [1, 10, 19])
def test_runs_that_do_not_pair_are_refused(runs):
    rng, a, b = np.random.default_rng(0), np.arange(20.0), np.arange(float(runs))
    drawn = (improvement_interval, same_distribution_p, spread_interval)
    for call in (difference_interval, slope_interval, ratio_interval, *drawn):
        drawing = [rng] if call in drawn else []
        with pytest.raises(ValueError, match=r"must pair|at least 2 runs"):
            call(a, b, *drawing)


def test_a_paired_difference_is_not_widened_by_what_the_pairs_share():
    rng = np.random.default_rng(0)
    shared = 100 * rng.standard_normal(20)
    a, b = shared + 0.5 + 0.01 * rng.standard_normal(20), shared
    gain = difference_interval(a, b)
    np.testing.assert_allclose(gain, mean_interval(a - b))
    assert 0.48 < gain.low < gain.high < 0.52
    single, half = np.full(4, 1 + 2**-20, dtype=np.float32), np.ones(4, dtype=np.float16)
    assert difference_interval(single, half).centre == 2**-20


def test_the_slope_is_that_of_least_squares_and_its_interval_students():
    rng, x = np.random.default_rng(0), np.linspace(0, 4, 20)
    y = 1.0 - 0.2 * x + rng.normal(0, 0.3, 20)
    (slope, _), covariance = np.polyfit(x, y, 1, cov=True)
    half = 2.1009 * covariance[0, 0] ** 0.5  # of 18 degrees of freedom
    assert slope_interval(x, y) == pytest.approx((slope, slope - half, slope + half), rel=1e-4)


@pytest.mark.parametrize("x", [[1.0, 2.0], [1.0, 1.0, 1.0], [[1.0, 2.0]] * 3])
def test_a_slope_needs_three_runs_at_different_places(x):
    with pytest.raises(ValueError, match="at least 3 runs"):
        slope_interval(np.array(x), np.array(x))


def test_a_ratio_of_means_feels_only_what_its_pairs_do_not_share():
    b = np.array([1.0, 2.0, 3.0, 6.0])
    assert ratio_interval(0.5 * b, b) == pytest.approx((0.5, 0.5, 0.5))
    # by hand: means 3 and 3, residuals a - b of 2, 0, 0 and -2
    a = b + np.array([2.0, 0, 0, -2.0])
    half = 3.1824 * math.sqrt(8 / 3) / 2 / 3
    assert ratio_interval(a, b) == pytest.approx((1, 1 - half, 1 + half), rel=1e-4)
    assert ratio_interval(-a, -b) == pytest.approx(ratio_interval(a, b))


def test_ratios_of_means_and_of_deviations_are_covered():
    rng, covered = np.random.default_rng(5), np.zeros(2)
    # pairs that share half of their variance; the deviations' ratio is 2
    for _ in range(400):
        shared, own = rng.standard_normal((2, 20))
        b = 5 + shared
        a = 3 + 2 * (shared + own) / math.sqrt(2)
        for i, (found, truth) in enumerate(
            [(ratio_interval(a, b), 0.6), (spread_interval(a, b, rng, draws=200), 2.0)]
        ):
            covered[i] += found.low <= truth <= found.high
    # standard error 0.011; a percentile bootstrap of twenty pairs is a little short
    assert 0.92 < covered[0] / 400 < 0.985
    assert 0.86 < covered[1] / 400 < 0.985


def test_a_ratio_of_deviations_is_that_of_the_runs_and_resamples_them_in_pairs():
    rng, b = np.random.default_rng(0), np.random.default_rng(1).standard_normal(20)
    assert spread_interval(7 - 3 * b, b, rng, 50) == pytest.approx((3, 3, 3))
    a = np.random.default_rng(2).standard_normal(20)
    found = spread_interval(a, b, rng)
    assert found.centre == pytest.approx(np.std(a, ddof=1) / np.std(b, ddof=1))
    assert found.low < found.centre < found.high
    # runs of which almost all are alike: resamples without the odd one have no ratio
    odd = np.array([1.0, 0, 0, 0])
    assert spread_interval(odd, odd, rng) == pytest.approx((1, 1, 1))


@PROPERTY
@given(st.lists(st.floats(-100, 100), min_size=1, max_size=23))
def test_the_interquartile_mean_is_that_of_the_middle_half_of_four_copies(values):
    middle = sorted(values * 4)[len(values) : 3 * len(values)]
    expected = math.fsum(middle) / len(middle)
    assert interquartile_mean(np.array(values)) == pytest.approx(expected, abs=1e-9)
    columns = interquartile_mean(np.stack([values, np.negative(values)], 1))
    np.testing.assert_allclose(columns, [expected, -expected], atol=1e-9)


def test_the_bootstrap_depends_on_its_generator_alone_and_resamples_runs_whole():
    values = np.random.default_rng(0).random((10, 1)) * np.ones(5)
    one, same, other = (
        bootstrap_interval(values, np.random.default_rng(seed), draws=50) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one.low, other.low)
    np.testing.assert_array_equal(one.centre, interquartile_mean(values))
    assert all(np.ptp(end) < 1e-12 for end in one)
    assert one.low[0] < one.centre[0] < one.high[0]


def test_a_stratified_bootstrap_covers_and_does_not_count_what_tasks_differ_by():
    rng = np.random.default_rng(2)
    covered, widths = 0, []
    for _ in range(300):
        values = LEVEL + rng.standard_normal(20)
        mine = bootstrap_interval(values, rng, strata=TASKS, draws=200)
        pooled = bootstrap_interval(values, rng, draws=200)
        # the middle half of the pooled runs is that of tasks 1 and 2
        covered += mine.low <= 15.0 <= mine.high
        widths.append((mine.high - mine.low, pooled.high - pooled.low))
    # strata of five runs make the interval too short by sqrt(4/5): 0.92 instead of 0.95
    assert 0.85 < covered / 300 < 0.97
    mine, pooled = np.mean(widths, 0)
    assert mine < 0.2 * pooled


@pytest.mark.parametrize("shift", [0.0, 0.8])
def test_the_probability_of_improvement_is_covered(shift):
    rng = np.random.default_rng(3)
    truth = 0.5 * (1 + math.erf(shift / 2))  # of two normal runs, one shifted
    covered = 0
    for _ in range(300):
        a, b = LEVEL + shift + rng.standard_normal(20), LEVEL + rng.standard_normal(20)
        interval = improvement_interval(a, b, rng, TASKS, draws=200)
        covered += interval.low <= truth <= interval.high
    assert 0.86 < covered / 300 < 0.98


def test_the_probability_of_improvement_counts_pairs_of_a_task():
    rng, tasks = np.random.default_rng(0), np.array([0, 1, 0, 1, 1])
    a, b = np.array([1.0, 9.0, 2.0, 9.0, 9.0]), np.array([0.0, 9.0, 1.0, 9.0, 9.0])
    # task 0: three wins and a tie in four pairs; task 1: nine ties
    expected = (3.5 / 4 + 0.5) / 2
    assert improvement_interval(a, b, rng, tasks, 50).centre == pytest.approx(expected)
    assert improvement_interval(b, a, rng, tasks, 50).centre == pytest.approx(1 - expected)
    assert improvement_interval(b, b, rng, draws=50).centre == 0.5


@pytest.mark.parametrize("strata", [TASKS[:5], TASKS.reshape(4, 5), np.arange(20)])
def test_strata_must_fit_the_runs_and_have_two_each(strata):
    for call in (bootstrap_interval, lambda a, *rest: improvement_interval(a, a, *rest)):
        with pytest.raises(ValueError, match=r"as many strata|two or more"):
            call(np.zeros(20), np.random.default_rng(0), strata)


def test_a_shift_of_each_pair_is_found_and_equal_runs_are_not():
    rng = np.random.default_rng(4)
    a = rng.normal(size=20)
    assert same_distribution_p(a, a + 2, rng) < 0.001
    assert same_distribution_p(a, a, rng) == same_distribution_p(0 * a, 0 * a, rng) == 1


@pytest.mark.parametrize("draws", [10, 4000])
def test_equal_values_count_as_one_step(draws):
    # all 16 exchanges of four pairs of few different values, by the definition of the distance
    rng, points = np.random.default_rng(6), np.arange(3)
    for _ in range(20):
        pairs = rng.integers(0, 3, (4, 2)).astype(float)
        distances = []
        for turned in product((False, True), repeat=4):
            x, y = np.where(np.array(turned)[:, None], pairs[:, ::-1], pairs).T
            below = [(sample[:, None] <= points).sum(0) for sample in (x, y)]
            distances.append(np.abs(below[0] - below[1]).max())
        exact = np.mean(np.array(distances) >= distances[0])
        # fewer draws than exchanges are random ones; more are not needed
        error = 4 * 0.5 / np.sqrt(draws) + 1 / draws if draws < 16 else 1e-12
        assert same_distribution_p(*pairs.T, rng, draws) == pytest.approx(exact, abs=error)


def test_holms_p_values_are_those_of_its_steps():
    p = np.array([0.01, 0.04, 0.03, 0.005])
    # 4 * .005, 3 * .01, 2 * .03, and .04, which must not be less than the one before
    np.testing.assert_allclose(holm(p), [0.03, 0.06, 0.06, 0.02])
    np.testing.assert_allclose(holm(np.array([0.9, 0.6])), [1.0, 1.0])


def test_with_holm_a_false_finding_among_many_is_as_rare_as_its_level():
    rng = np.random.default_rng(0)
    false = [(holm(rng.random(20)) < 0.05).any() for _ in range(2000)]
    # by independence 1 - (1 - .05 / 20)^20 = .0488, within three standard errors
    assert abs(np.mean(false) - 0.0488) < 3 * (0.0488 / 2000) ** 0.5


def test_paired_runs_are_tested_by_their_differences():
    rng = np.random.default_rng(1)
    base, shift = rng.normal(0, 100, 30), rng.normal(0.5, 1, 30)
    t = shift.mean() / (shift.std(ddof=1) / 30**0.5)
    assert paired_p(base + shift, base) == pytest.approx(2 * student.sf(abs(t), 29), rel=1e-6)
