"""Summaries over independent runs: the thesis' mean and its interval."""

import math
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from scipy.special import stdtrit


class Interval(NamedTuple):
    """A central value with the ends of its 95 % confidence interval."""

    centre: ndarray | float
    low: ndarray | float
    high: ndarray | float


def mean_interval(values: ndarray) -> Interval:
    """Mean over runs (axis 0) with its 95 % Student interval, as in the thesis' figures.

    values: (R, ...) with R >= 2; raises ValueError with fewer runs or values that are not finite.
    """
    (values,) = checked_runs(values)
    centre, runs = values.mean(0), len(values)
    half = stdtrit(runs - 1, 0.975) * values.std(0, ddof=1) / math.sqrt(runs)
    return Interval(centre, centre - half, centre + half)


def difference_interval(a: ndarray, b: ndarray) -> Interval:
    """Mean of the paired differences a - b over runs (axis 0) with its 95 % interval."""
    return mean_interval(np.subtract(*checked_runs(a, b)))


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
