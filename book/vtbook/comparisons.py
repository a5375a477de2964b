"""Comparisons of algorithms over runs: ratios, slopes, tests, and robust means."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy import ndarray
from numpy.random import Generator
from scipy import stats

from vtlib.checks import check_whole, shown
from vtlib.stats import Interval, checked_runs


def student_interval(centre: float, error: float, freedom: int) -> Interval:
    """A centre with its 95 % interval by Student's law, from its standard error."""
    half = stats.t.ppf(0.975, freedom) * error
    return Interval(centre, centre - half, centre + half)


def ratio_interval(a: ndarray, b: ndarray) -> Interval:
    """Ratio of the means of paired runs a and b (R,), with its 95 % interval to first order."""
    a, b = checked_runs(a, b)
    ratio, below = a.mean() / b.mean(), abs(b.mean())
    return student_interval(ratio, stats.sem(a - ratio * b) / below, len(a) - 1)


def spread_interval(a: ndarray, b: ndarray, rng: Generator, draws: int = 2000) -> Interval:
    """Ratio of the standard deviations of paired runs a and b (R,), with its 95 % interval.

    Bootstrap: pairs of runs are resampled whole; a ratio over runs that are all alike is left out.
    """
    a, b = checked_runs(a, b)
    chosen = rng.integers(len(a), size=(draws, len(a)))
    below = b[chosen].std(1, ddof=1)
    ratios = a[chosen].std(1, ddof=1)[below > 0] / below[below > 0]
    centre = a.std(ddof=1) / b.std(ddof=1)
    return Interval(centre, *np.quantile(ratios, [0.025, 0.975]))


def slope_interval(x: ndarray, y: ndarray) -> Interval:
    """Least-squares slope of y on x, both (R,), with its 95 % Student interval.

    Raises ValueError with fewer than 3 runs, values that are not finite, or when all x are equal.
    """
    x, y = checked_runs(x, y)
    if x.ndim > 1 or len(x) < 3 or np.ptp(x) == 0:
        raise ValueError(f"a slope needs at least 3 runs at different places, got {shown(x)}")
    line = stats.linregress(x, y)
    return student_interval(line.slope, line.stderr, len(x) - 2)


def holm(p: ndarray) -> ndarray:
    """P values (n,) adjusted for being n tests, so that any false finding has their level.

    Source: Holm (1979).
    """
    order = np.argsort(p)
    stepped = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)).clip(max=1)
    adjusted = np.empty(len(p))
    adjusted[order] = stepped
    return adjusted


def paired_p(a: ndarray, b: ndarray) -> float:
    """P value of the hypothesis that paired runs a and b (R,) have one mean, by Student's t."""
    a, b = checked_runs(a, b)
    return float(stats.ttest_rel(a, b).pvalue)


def interquartile_mean(values: ndarray) -> ndarray:
    """Mean of the middle half of the runs (axis 0); runs at its edges count in part.

    Source: Agarwal et al. (2021).
    """
    # Of four copies of each run a quarter is a whole number, so the trimmed mean cuts no more.
    mean: ndarray = stats.trim_mean(np.repeat(values, 4, axis=0), 0.25)
    return mean


def bootstrap_interval(
    values: ndarray, rng: Generator, strata: ndarray | None = None, draws: int = 2000
) -> Interval:
    """Interquartile mean over runs (axis 0) with its 95 % percentile bootstrap interval.

    values: (R, ...). Runs are resampled whole, within each of the strata (R,), which are tasks of
    at least 2 runs, when these are given. Source: Agarwal et al. (2021).
    """

    def middle(*drawn: ndarray, axis: int) -> ndarray:
        return interquartile_mean(np.moveaxis(np.concatenate(drawn, axis), axis, 0))

    return _bootstrap(checked_runs(values), strata, middle, rng, draws)


def improvement_interval(
    a: ndarray, b: ndarray, rng: Generator, strata: ndarray | None = None, draws: int = 2000
) -> Interval:
    """Probability of improvement with its 95 % stratified bootstrap interval.

    The probability that a run of a (R,) earns more than a run of b (R,) of the same stratum, ties
    counted half, averaged over the strata; both are resampled independently. Without strata all
    runs are of one. Source: Agarwal et al. (2021).
    """

    def probability(*drawn: ndarray, axis: int) -> ndarray:
        half = len(drawn) // 2
        # Mann and Whitney's statistic is the number of pairs that are won.
        won = [
            stats.mannwhitneyu(x, y, axis=axis, method="asymptotic").statistic / x.shape[axis] ** 2
            for x, y in zip(drawn[:half], drawn[half:], strict=True)
        ]
        return np.asarray(np.mean(won, axis=0))

    return _bootstrap(checked_runs(a, b), strata, probability, rng, draws)


def _bootstrap(
    samples: list[ndarray],
    strata: ndarray | None,
    statistic: Callable[..., ndarray],
    rng: Generator,
    draws: int,
) -> Interval:
    """The statistic with its interval; every stratum of every sample is resampled by itself."""
    check_whole("draws", draws)
    runs = len(samples[0])
    strata = np.zeros(runs) if strata is None else np.asarray(strata)
    if strata.shape != (runs,):
        raise ValueError(f"{runs} runs need as many strata, got shape {strata.shape}")
    parts = [sample[strata == one] for sample in samples for one in np.unique(strata)]
    found = stats.bootstrap(
        parts, statistic, n_resamples=draws, vectorized=True, method="percentile", rng=rng
    )
    return Interval(statistic(*parts, axis=0), *found.confidence_interval)
