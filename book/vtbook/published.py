"""The published curves, read off the figures of the authors' conference paper (book/published)."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vtlab.stats import Interval

FOLDER = Path(__file__).resolve().parents[1] / "published"


class PublishedCurve(NamedTuple):
    """Mean and 95 % interval (T,) of 20 runs at iterations (T,)."""

    iterations: np.ndarray
    mean: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def at(self, t: int) -> Interval:
        """The value at an iteration, or the one before that; ValueError before the first."""
        places = np.flatnonzero(self.iterations <= t)
        if not len(places):
            raise ValueError(f"the published curve begins at {self.iterations[0]:g}, not at {t}")
        i = places[-1]
        return Interval(self.mean[i], self.low[i], self.high[i])

    def until(self, t: int) -> Interval:
        """The mean until an iteration, with the mean width of the band."""
        before = self.iterations <= t
        return Interval(*(x[before].mean() for x in (self.mean, self.low, self.high)))


def rows(name: str) -> np.ndarray:
    """The rows of a file in book/published as a structured array, columns by their names."""
    path = FOLDER / f"{name}.csv"
    table: np.ndarray = np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")
    return table


def curves(figure: str, kind: str) -> Mapping[str, PublishedCurve]:
    """The curves of a figure by algorithm; kind is "learning" or "greedy"."""
    table = rows(f"{figure}-{kind}")
    return {
        str(label): PublishedCurve(
            *(table[table["algorithm"] == label][x] for x in ("iteration", "mean", "low", "high"))
        )
        for label in np.unique(table["algorithm"])
    }
