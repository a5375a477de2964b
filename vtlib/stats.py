"""Summaries over independent runs: the thesis' mean and its interval."""

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy import ndarray


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
    centre, runs = values.mean(0), len(values)
    half = student_quantile(runs - 1) * values.std(0, ddof=1) / math.sqrt(runs)
    return Interval(centre, centre - half, centre + half)


def difference_interval(a: ndarray, b: ndarray) -> Interval:
    """Mean of the paired differences a - b over runs (axis 0) with its 95 % interval."""
    return mean_interval(np.subtract(*checked_runs(a, b)))


@functools.cache
def student_quantile(freedom: int) -> float:
    """The t that 95 % of a Student distribution lie within, of either sign.

    Found by bisection of the finite sum that gives that share for whole degrees of freedom. Source:
    Abramowitz and Stegun (1964), 26.7.3 and 26.7.4.
    """
    low, high = 0.0, math.pi / 2
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if _share_within(middle, freedom) < 0.95 else (low, middle)
    return math.sqrt(freedom) * math.tan(low)


def _share_within(angle: float, freedom: int) -> float:
    """The share of a Student distribution up to t = sqrt(freedom) tan(angle), of either sign."""
    first = 1 + freedom % 2  # the sum begins at 2 for odd degrees of freedom, else at 1
    term, total = (math.cos(angle) if freedom % 2 else 1.0), 0.0
    for k in range(first, freedom, 2):
        total += term
        term *= math.cos(angle) ** 2 * k / (k + 1)
    if freedom % 2:
        return 2 / math.pi * (angle + math.sin(angle) * total)
    return math.sin(angle) * total


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
