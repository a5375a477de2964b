"""Intervals and robust means against their definitions, and their coverage by simulation."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vtlib.stats import (
    STUDENT_95,
    bootstrap_interval,
    difference_interval,
    improvement_interval,
    interquartile_mean,
    mean_interval,
    same_distribution_p,
    slope_interval,
)

PROPERTY = settings(deadline=None, derandomize=True)
REPLICATES = 4000
# Four standard errors of a share near 0.95 over the replicates.
SIMULATION = 4 * math.sqrt(0.95 * 0.05 / REPLICATES)


def student_density(t: np.ndarray, freedom: int) -> np.ndarray:
    log = math.lgamma((freedom + 1) / 2) - math.lgamma(freedom / 2)
    scale = math.exp(log) / math.sqrt(freedom * math.pi)
    return scale * (1 + t**2 / freedom) ** (-(freedom + 1) / 2)


def student_within(quantile: float, freedom: int) -> float:
    """Probability that |T| <= quantile, by Simpson's rule."""
    t = np.linspace(0, quantile, 20_001)
    weight = np.ones(len(t))
    weight[1:-1:2], weight[2:-1:2] = 4, 2
    return 2 * float(weight @ student_density(t, freedom)) * (t[1] - t[0]) / 3


def implied_quantile(runs: int) -> float:
    """The quantile that an interval over so many runs was built with."""
    values = np.arange(runs, dtype=np.float64)
    interval = mean_interval(values)
    return float((interval.high - interval.centre) * math.sqrt(runs) / values.std(ddof=1))


@pytest.mark.parametrize("freedom", range(1, len(STUDENT_95) + 1))
def test_the_table_holds_the_quantiles_to_three_decimals(freedom):
    at = STUDENT_95[freedom - 1]
    below, above = (student_within(at + shift, freedom) for shift in (-0.0005, 0.0005))
    assert below <= 0.95 <= above


@pytest.mark.parametrize(
    ("runs", "quantile"), [(2, 12.706), (3, 4.303), (10, 2.262), (20, 2.093), (31, 2.042)]
)
def test_the_quantile_belongs_to_one_degree_of_freedom_less(runs, quantile):
    assert implied_quantile(runs) == pytest.approx(quantile)


@pytest.mark.parametrize("runs", [32, 40, 100, 1000])
def test_beyond_the_table_the_interval_covers_95_percent(runs):
    assert student_within(implied_quantile(runs), runs - 1) == pytest.approx(0.95, abs=1e-4)


def test_an_interval_of_known_numbers():
    interval = mean_interval(np.array([1.0, 2.0, 3.0, 6.0]))
    half = 3.182 * math.sqrt((4 + 1 + 0 + 9) / 3) / 2
    assert interval.centre == pytest.approx(3.0)
    assert (interval.low, interval.high) == pytest.approx((3 - half, 3 + half))


def test_each_column_has_its_own_interval():
    values = np.random.default_rng(0).standard_normal((7, 3, 4))
    whole = mean_interval(values)
    assert whole.centre.shape == whole.low.shape == whole.high.shape == (3, 4)
    for i, j in np.ndindex(3, 4):
        np.testing.assert_allclose([x[i, j] for x in whole], mean_interval(values[:, i, j]))


def test_single_precision_is_summed_in_double():
    values = np.array([1e8, 1, -1e8, 1], dtype=np.float32)
    assert mean_interval(values).centre == pytest.approx(0.5)


@pytest.mark.parametrize("runs", [5, 10, 20])
def test_mean_intervals_cover_the_mean_in_95_percent_of_the_cases(runs):
    values = np.random.default_rng(runs).normal(3.0, 2.0, (runs, REPLICATES))
    interval = mean_interval(values)
    covered = ((interval.low <= 3.0) & (interval.high >= 3.0)).mean()
    assert covered == pytest.approx(0.95, abs=SIMULATION)


@pytest.mark.parametrize("values", [np.array(1.0), np.zeros((0, 3)), np.zeros((1, 3)), [0.5]])
def test_fewer_than_two_runs_have_no_interval(values):
    with pytest.raises(ValueError, match="at least 2 runs, got shape"):
        mean_interval(values)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_have_no_interval(bad):
    with pytest.raises(ValueError, match="finite values, got NaN or infinity"):
        mean_interval(np.array([[0.0, 1.0], [2.0, bad]]))


def naive_interquartile_mean(values: list[float]) -> float:
    """Every value four times over, then the mean of the middle half of the copies."""
    copies = sorted(values * 4)
    middle = copies[len(values) : 3 * len(values)]
    return math.fsum(middle) / len(middle)


@PROPERTY
@given(st.lists(st.floats(-100, 100), min_size=1, max_size=23))
def test_the_interquartile_mean_equals_its_definition(values):
    expected = naive_interquartile_mean(values)
    assert interquartile_mean(np.array(values)) == pytest.approx(expected, abs=1e-9)


def test_the_interquartile_mean_ignores_the_outer_quarters():
    assert interquartile_mean(np.array([-1e9, 1.0, 3.0, 1e9])) == pytest.approx(2.0)
    values = np.random.default_rng(0).standard_normal((20, 3))
    worse = values.copy()
    worse[values.argmin(0), range(3)] = -1e6
    np.testing.assert_allclose(interquartile_mean(worse), interquartile_mean(values))
    assert interquartile_mean(values).shape == (3,)


@pytest.mark.parametrize(
    ("statistic", "draw"),
    [
        (interquartile_mean, lambda rng, shape: rng.standard_normal(shape)),
        (interquartile_mean, lambda rng, shape: rng.uniform(-1, 1, shape)),
        (lambda values: values.mean(0), lambda rng, shape: rng.standard_normal(shape)),
    ],
    ids=["normal", "uniform", "mean"],
)
def test_bootstrap_intervals_cover_nearly_95_percent(statistic, draw):
    # Percentile intervals of 20 runs are known to be a little too short: 0.90 to 0.95 is right.
    rng = np.random.default_rng(1)
    values = draw(rng, (20, 1500))
    interval = bootstrap_interval(values, rng, statistic, draws=400)
    covered = ((interval.low <= 0) & (interval.high >= 0)).mean()
    assert 0.89 < covered < 0.96


def test_the_bootstrap_depends_on_its_generator_alone():
    values = np.random.default_rng(0).random((10, 2))
    one, same, other = (
        bootstrap_interval(values, np.random.default_rng(seed), draws=50) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one.low, other.low)
    np.testing.assert_array_equal(one.centre, interquartile_mean(values))


def test_the_bootstrap_resamples_runs_whole():
    values = np.random.default_rng(0).random((10, 1)) * np.ones(5)
    interval = bootstrap_interval(values, np.random.default_rng(0), draws=50)
    for end in interval:
        assert np.ptp(end) < 1e-12


def test_the_bootstrap_of_equal_runs_is_a_point():
    interval = bootstrap_interval(np.full((8, 2), 0.7), np.random.default_rng(0), draws=20)
    np.testing.assert_allclose(interval, 0.7)


@pytest.mark.parametrize("values", [[[0.5]], np.zeros((0, 2)), [[0.1], [np.nan]]])
def test_the_bootstrap_refuses_what_an_interval_refuses(values):
    with pytest.raises(ValueError, match=r"at least 2 runs|finite"):
        bootstrap_interval(np.array(values), np.random.default_rng(0), draws=10)


TASKS = np.repeat(np.arange(4), 5)


def test_a_stratified_bootstrap_covers_and_does_not_count_what_tasks_differ_by():
    rng = np.random.default_rng(2)
    level = 10.0 * TASKS
    covered, widths = 0, []
    for _ in range(600):
        values = level + rng.standard_normal(20)
        mine = bootstrap_interval(values, rng, np.mean, TASKS, draws=200)
        pooled = bootstrap_interval(values, rng, np.mean, draws=200)
        covered += mine.low <= level.mean() <= mine.high
        widths.append((mine.high - mine.low, pooled.high - pooled.low))
    # strata of five runs make the interval too short by sqrt(4/5): 0.92 instead of 0.95
    assert 0.87 < covered / 600 < 0.96
    mine, pooled = np.mean(widths, 0)
    assert mine < 0.2 * pooled


def test_strata_must_fit_the_runs():
    with pytest.raises(ValueError, match="as many strata"):
        bootstrap_interval(np.zeros(20), np.random.default_rng(0), strata=TASKS[:5])


@pytest.mark.parametrize("shift", [0.0, 0.8])
def test_the_probability_of_improvement_is_covered(shift):
    rng = np.random.default_rng(3)
    truth = 0.5 * (1 + math.erf(shift / 2))  # of two normal runs, one shifted
    covered = 0
    for _ in range(300):
        level = 10.0 * TASKS
        a, b = level + shift + rng.standard_normal(20), level + rng.standard_normal(20)
        interval = improvement_interval(a, b, rng, TASKS, draws=200)
        covered += interval.low <= truth <= interval.high
    assert 0.86 < covered / 300 < 0.98


def test_the_probability_of_improvement_counts_pairs_of_a_task():
    rng = np.random.default_rng(0)
    a, b = np.array([1.0, 2.0, 9.0, 9.0]), np.array([0.0, 1.0, 9.0, 9.0])
    interval = improvement_interval(a, b, rng, np.array([0, 0, 1, 1]), draws=50)
    # task 0: three wins and a tie in four pairs; task 1: four ties
    assert interval.centre == pytest.approx((3.5 / 4 + 0.5) / 2)
    assert improvement_interval(b, b, rng, draws=50).centre == 0.5
    back = improvement_interval(b, a, rng, np.array([0, 0, 1, 1]), draws=50)
    assert back.centre == pytest.approx(1 - interval.centre)


@pytest.mark.parametrize("b", [np.zeros(3), np.zeros((4, 2)), np.array([0, 0, 0, np.nan])])
def test_improvement_needs_finite_runs_of_one_shape(b):
    with pytest.raises(ValueError, match=r"two algorithms|finite"):
        improvement_interval(np.zeros(4), b, np.random.default_rng(0), draws=10)


def test_no_run_has_no_interquartile_mean():
    with pytest.raises(ValueError, match="at least"):
        interquartile_mean(np.zeros((0, 2)))


def test_a_paired_difference_is_not_widened_by_what_the_pairs_share():
    rng = np.random.default_rng(0)
    shared = 100 * rng.standard_normal(20)
    a, b = shared + 0.5 + 0.01 * rng.standard_normal(20), shared
    gain = difference_interval(a, b)
    np.testing.assert_allclose(gain, mean_interval(a - b))
    assert gain.low > 0.48
    assert gain.high < 0.52
    np.testing.assert_allclose(difference_interval(b, a).high, -gain.low)


def test_a_difference_is_taken_in_double():
    a, b = np.full(4, 1 + 2**-20, dtype=np.float32), np.ones(4, dtype=np.float16)
    assert difference_interval(a, b).centre == pytest.approx(2**-20)


def test_runs_that_do_not_pair_have_no_difference():
    with pytest.raises(ValueError, match="20"):
        difference_interval(np.zeros(20), np.zeros(10))


def test_one_run_does_not_pair_with_many():
    with pytest.raises(ValueError):
        difference_interval(np.zeros(20), np.zeros(1))


def test_slope_is_that_of_least_squares_and_covers():
    rng = np.random.default_rng(0)
    x = rng.uniform(0, 4, 20)
    covered = 0
    for _ in range(2000):
        y = 1.0 - 0.2 * x + rng.normal(0, 0.3, 20)
        band = slope_interval(x, y)
        covered += band.low <= -0.2 <= band.high
    assert band.centre == pytest.approx(np.polyfit(x, y, 1)[0])
    # 95% of 2,000 with a standard error of 0.5%
    assert abs(covered / 2000 - 0.95) < 0.02


@pytest.mark.parametrize("x", [[1.0, 2.0], [1.0, 1.0, 1.0]])
def test_slope_needs_three_runs_at_different_places(x):
    with pytest.raises(ValueError, match="at least 3 runs"):
        slope_interval(np.array(x), np.array(x))


def test_exchangeable_pairs_are_rejected_as_often_as_the_level_says():
    rng = np.random.default_rng(3)
    pairs = rng.normal(size=(300, 2, 15)) + 3 * rng.normal(size=(300, 1, 15))
    p = np.array([same_distribution_p(a, b, rng, 200) for a, b in pairs])
    # binomial: 300 tests at 0.1 reject 30 +- 5.2; ties of the distance make it fewer
    assert (p <= 0.1).sum() < 30 + 4 * 5.2
    assert (p <= 0.5).mean() > 0.2


def test_a_shift_of_each_pair_is_found_and_needs_no_ties():
    rng = np.random.default_rng(4)
    a = rng.normal(size=20)
    assert same_distribution_p(a, a + 2, rng) < 0.001
    assert same_distribution_p(a, a, rng) == 1
    assert same_distribution_p(np.zeros(20), np.zeros(20), rng) == 1


def test_the_p_value_of_few_pairs_is_what_counting_gives():
    # two pairs, apart: of the four exchanges two are as far apart as observed
    a, b = np.array([0.0, 1.0]), np.array([10.0, 11.0])
    p = same_distribution_p(a, b, np.random.default_rng(5), 20_000)
    assert p == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(20_000))


def test_equal_values_count_as_one_step():
    # all 16 exchanges of four pairs of few different values, by the definition of the distance
    rng = np.random.default_rng(6)
    points = np.arange(3)
    for _ in range(20):
        pairs = rng.integers(0, 3, (4, 2)).astype(float)
        distances = []
        for turned in product((False, True), repeat=4):
            x, y = np.where(np.array(turned)[:, None], pairs[:, ::-1], pairs).T
            below = [(sample[:, None] <= points).sum(0) for sample in (x, y)]
            distances.append(np.abs(below[0] - below[1]).max())
        exact = np.mean(np.array(distances) >= distances[0])
        p = same_distribution_p(*pairs.T, rng, 4000)
        assert p == pytest.approx(exact, abs=4 * 0.5 / np.sqrt(4000) + 1e-3)


@pytest.mark.parametrize(("a", "b"), [([1, 2], [1]), ([], []), ([[1, 2]], [[1, 2]])])
def test_pairs_must_be_pairs(a, b):
    with pytest.raises(ValueError, match="needs pairs of runs"):
        same_distribution_p(np.array(a), np.array(b), np.random.default_rng(0))
