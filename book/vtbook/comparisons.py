"""Comparisons of algorithms over runs: ratios, slopes and tests."""

import numpy as np
from numpy import ndarray
from numpy.random import Generator
from scipy import stats

from vtlab.stats import Interval, checked_runs


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
    """Least-squares slope of y on x, both (R,), with its 95 % Student interval."""
    x, y = checked_runs(x, y)
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
