"""Summaries over independent runs: the thesis' mean and interval, and robust ones beside them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from vtlib.checks import check_whole, shown

# Two-sided 95 % quantiles of Student's t for 1 to 30 degrees of freedom.
STUDENT_95 = (
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228,
    2.201, 2.179, 2.160, 2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086,
    2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042,
)  # fmt: skip


class Interval(NamedTuple):
    """A central value with the ends of its 95 % confidence interval."""

    centre: np.ndarray | float
    low: np.ndarray | float
    high: np.ndarray | float


def mean_interval(values: np.ndarray) -> Interval:
    """Mean over runs (axis 0) with its 95 % Student interval, as in the thesis' figures.

    values: (R, ...) with R >= 2; raises ValueError with fewer runs or values that are not finite.
    """
    values = _checked(values)
    runs = len(values)
    mean = values.mean(0)
    half = _student_95(runs - 1) * values.std(0, ddof=1) / np.sqrt(runs)
    return Interval(mean, mean - half, mean + half)


def _checked(values: np.ndarray) -> np.ndarray:
    values = np.asarray(values, dtype=np.float64)
    if values.ndim == 0 or len(values) < 2:
        raise ValueError(f"an interval needs at least 2 runs, got shape {values.shape}")
    if not np.isfinite(values).all():
        raise ValueError("an interval needs finite values, got NaN or infinity")
    return values


def _student_95(freedom: int) -> float:
    if freedom <= len(STUDENT_95):
        return STUDENT_95[freedom - 1]
    # two terms of the Cornish-Fisher expansion around the normal quantile: right to 1e-4
    z = 1.959964
    return z + (z**3 + z) / (4 * freedom) + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * freedom**2)


def interquartile_mean(values: np.ndarray) -> np.ndarray:
    """Mean of the middle half of the runs (axis 0), with fractional weights at its edges.

    Source: Agarwal et al. (2021).
    """
    ordered = np.sort(np.asarray(values, dtype=np.float64), axis=0)
    runs = len(ordered)
    if runs == 0:
        raise ValueError(f"a mean needs at least 1 run, got shape {ordered.shape}")
    low, high = 0.25 * runs, 0.75 * runs
    at = np.arange(runs)
    weight = np.clip(np.minimum(at + 1, high) - np.maximum(at, low), 0, 1)
    mean: np.ndarray = np.tensordot(weight, ordered, 1) / weight.sum()
    return mean


def bootstrap_interval(
    values: np.ndarray,
    rng: np.random.Generator,
    statistic: Callable[[np.ndarray], np.ndarray] = interquartile_mean,
    strata: np.ndarray | None = None,
    draws: int = 2000,
) -> Interval:
    """A statistic over runs (axis 0) with its 95 % percentile bootstrap interval.

    values: (R, ...). Runs are resampled whole by the given generator, within each of the strata
    (R,), which are tasks, when these are given. Source: Agarwal et al. (2021).
    """
    values = _checked(values)
    picks = _resampled(_checked_strata(strata, len(values)), rng, draws)
    drawn = np.stack([statistic(values[pick]) for pick in picks])
    low, high = np.quantile(drawn, (0.025, 0.975), axis=0)
    return Interval(statistic(values), low, high)


def _checked_strata(strata: np.ndarray | None, runs: int) -> np.ndarray:
    """The strata (R,), all alike when none are given."""
    strata = np.zeros(runs) if strata is None else np.asarray(strata)
    if strata.shape != (runs,):
        raise ValueError(f"{runs} runs need as many strata, got shape {strata.shape}")
    return strata


def _resampled(strata: np.ndarray, rng: np.random.Generator, draws: int) -> np.ndarray:
    """Indices (draws, R): each stratum's runs drawn from that stratum with replacement."""
    check_whole("draws", draws)
    picks = np.empty((draws, len(strata)), dtype=np.int64)
    for stratum in np.unique(strata):
        members = np.flatnonzero(strata == stratum)
        picks[:, members] = members[rng.integers(len(members), size=(draws, len(members)))]
    return picks


def improvement_interval(
    a: np.ndarray,
    b: np.ndarray,
    rng: np.random.Generator,
    strata: np.ndarray | None = None,
    draws: int = 2000,
) -> Interval:
    """Probability of improvement with its 95 % stratified bootstrap interval.

    The probability that a run of a (R,) earns more than a run of b (R,) of the same stratum, ties
    counted half, averaged over the strata; both are resampled independently. Without strata all
    runs are of one. Source: Agarwal et al. (2021).
    """
    a, b = _checked(a), _checked(b)
    if a.shape != b.shape or a.ndim != 1:
        raise ValueError(f"needs runs of two algorithms, both (R,), got {a.shape} and {b.shape}")
    strata = _checked_strata(strata, len(a))
    wins = (a[:, None] > b) + 0.5 * (a[:, None] == b)
    groups = [np.flatnonzero(strata == stratum) for stratum in np.unique(strata)]

    def probability(of_a: np.ndarray, of_b: np.ndarray) -> float:
        return float(np.mean([wins[np.ix_(of_a[g], of_b[g])].mean() for g in groups]))

    everyone = np.arange(len(a))
    pairs = zip(_resampled(strata, rng, draws), _resampled(strata, rng, draws), strict=True)
    drawn = [probability(of_a, of_b) for of_a, of_b in pairs]
    low, high = np.quantile(drawn, (0.025, 0.975))
    return Interval(probability(everyone, everyone), low, high)


def difference_interval(a: np.ndarray, b: np.ndarray) -> Interval:
    """Mean of the paired differences a - b over runs (axis 0) with its 95 % interval."""
    a, b = _checked(a), _checked(b)
    if a.shape != b.shape:
        raise ValueError(f"paired runs must have equal shapes, got {a.shape} and {b.shape}")
    return mean_interval(a - b)


def same_distribution_p(
    a: np.ndarray, b: np.ndarray, rng: np.random.Generator, draws: int = 10_000
) -> float:
    """P value of the hypothesis that paired runs a (R,) and b (R,) could be exchanged.

    Statistic: the Kolmogorov-Smirnov distance of the two samples, the largest difference between
    their empirical distributions; its law under the hypothesis comes from exchanging the two runs
    of random pairs, so runs of equal seeds may depend on each other. Source: Good (2005).
    """
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if a.shape != b.shape or a.ndim != 1 or not len(a):
        raise ValueError(f"needs pairs of runs, both (R,), got {a.shape} and {b.shape}")
    pairs = np.stack([a, b], 1)
    order = np.argsort(pairs, axis=None, kind="stable")
    ends = np.append(np.diff(pairs.ravel()[order]) > 0, True)  # equal values make one step
    signs = rng.choice((-1, 1), size=(draws, len(a)))
    signs = np.concatenate([np.ones((1, len(a)), dtype=signs.dtype), signs])
    steps = np.stack([signs, -signs], 2).reshape(len(signs), -1)[:, order]
    distances = np.abs(np.where(ends, steps.cumsum(1), 0)).max(1)
    return float((distances[1:] >= distances[0]).sum() + 1) / (draws + 1)


def slope_interval(x: np.ndarray, y: np.ndarray) -> Interval:
    """Least-squares slope of y on x, both (R,), with its 95% Student interval.

    Raises ValueError with fewer than 3 runs, values that are not finite, or when all x are equal.
    """
    x, y = _checked(x), _checked(y)
    if x.shape != y.shape or x.ndim != 1:
        raise ValueError(f"a slope needs x and y, both (R,), got {x.shape} and {y.shape}")
    if len(x) < 3 or np.ptp(x) == 0:
        raise ValueError(f"a slope needs at least 3 runs at different places, got {shown(x)}")
    centred = x - x.mean()
    spread = centred @ centred
    slope = centred @ y / spread
    residual = y - y.mean() - slope * centred
    error = np.sqrt(residual @ residual / (len(x) - 2) / spread)
    half = _student_95(len(x) - 2) * error
    return Interval(slope, slope - half, slope + half)
