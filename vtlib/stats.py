"""Summaries over independent runs: the thesis' mean and interval, and a test for two samples."""

from typing import NamedTuple

import numpy as np
import scipy
from numpy import ndarray
from numpy.random import Generator


class Interval(NamedTuple):
    """A central value with the ends of its 95 % confidence interval."""

    centre: ndarray | float
    low: ndarray | float
    high: ndarray | float

    def __str__(self) -> str:
        return f"{self.centre:.3f} (95% interval {self.low:.3f} to {self.high:.3f})"


def mean_interval(values: ndarray) -> Interval:
    """Mean over runs (axis 0) with its 95 % Student interval, as in the thesis' figures.

    values: (R, ...) with R >= 2; raises ValueError with fewer runs or values that are not finite.
    """
    (values,) = checked_runs(values)
    centre = values.mean(0)
    half = scipy.stats.t.ppf(0.975, len(values) - 1) * scipy.stats.sem(values)
    return Interval(centre, centre - half, centre + half)


def difference_interval(a: ndarray, b: ndarray) -> Interval:
    """Mean of the paired differences a - b over runs (axis 0) with its 95 % interval."""
    return mean_interval(np.subtract(*checked_runs(a, b)))


def same_distribution_p(a: ndarray, b: ndarray, rng: Generator, draws: int = 10_000) -> float:
    """P value of the hypothesis that paired runs a (R,) and b (R,) could be exchanged.

    Statistic: the Kolmogorov-Smirnov distance of the two samples; its law under the hypothesis
    comes from exchanging the two runs of random pairs (in all ways, where those are fewer than the
    draws), so runs of equal seeds may depend on each other. Source: Good (2005).
    """
    found = scipy.stats.permutation_test(
        checked_runs(a, b),
        _distance,
        permutation_type="samples",
        vectorized=True,
        n_resamples=draws,
        batch=1_000,  # a million draws of many runs need not stand in memory at once
        alternative="greater",
        rng=rng,
    )
    return float(found.pvalue)


def _distance(x: ndarray, y: ndarray, axis: int) -> ndarray:
    """R times the Kolmogorov-Smirnov distance of samples x and y of R runs along an axis."""
    both = np.concatenate([x, y], axis)
    order = both.argsort(axis)
    steps = np.where(order < x.shape[axis], 1, -1).cumsum(axis)
    # Equal values make one step of the empirical distributions, at the last of them.
    ends = np.diff(np.take_along_axis(both, order, axis), axis=axis, append=np.inf) > 0
    largest: ndarray = np.abs(steps * ends).max(axis)
    return largest


def checked_runs(*samples: ndarray) -> list[ndarray]:
    """The samples in double precision, if they are of one shape, finite and of 2 runs or more."""
    checked = [np.asarray(sample, dtype=np.float64) for sample in samples]
    for values in checked:
        if values.ndim == 0 or len(values) < 2:
            raise ValueError(f"an interval needs at least 2 runs, got shape {values.shape}")
        if values.shape != checked[0].shape:
            raise ValueError(f"runs must pair, got {checked[0].shape} and {values.shape}")
        if not np.isfinite(values).all():
            raise ValueError("an interval needs finite values, got NaN or infinity")
    return checked
