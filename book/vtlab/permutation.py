"""A test whether two samples of runs could be exchanged."""

import numpy as np
import scipy
from numpy import ndarray
from numpy.random import Generator

from vtlab.stats import checked_runs


def same_distribution_p(a: ndarray, b: ndarray, rng: Generator, draws: int = 10_000) -> float:
    """P value of the hypothesis that paired runs a (R,) and b (R,) could be exchanged.

    The statistic is the Kolmogorov-Smirnov distance of the samples. Its law comes from exchanging
    the two runs of random pairs, or of all where those are few, so runs of equal seeds may depend
    on each other. Source: Good (2005).
    """
    test = scipy.stats.permutation_test(
        checked_runs(a, b),
        _distance,
        permutation_type="samples",
        vectorized=True,
        n_resamples=draws,
        batch=1_000,  # so that not all draws stand in memory at once
        alternative="greater",
        rng=rng,
    )
    return float(test.pvalue)


def _distance(x: ndarray, y: ndarray, axis: int) -> ndarray:
    """R times the Kolmogorov-Smirnov distance of samples x and y of R runs along an axis."""
    both = np.concatenate([x, y], axis)
    order = both.argsort(axis)
    steps = np.where(order < x.shape[axis], 1, -1).cumsum(axis)
    # Equal values make one step of the empirical distributions, at the last of them.
    ends = np.diff(np.take_along_axis(both, order, axis), axis=axis, append=np.inf) > 0
    largest: ndarray = np.abs(steps * ends).max(axis)
    return largest
