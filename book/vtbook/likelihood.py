"""Returns by the likelihood of the task (section 6.1.4), in the published figure's five bins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from xarray import Dataset

from vtbook.experiments import rooms
from vtbook.published import rows
from vtlab.experiment import Experiment
from vtlab.store import load, returns
from vtlib.stats import Interval, mean_interval

AT = (500, 1_000, 4_000)  # iterations
EDGES = np.linspace(0.2, 1.0, 5)  # upper ones, of the likelihood over its largest
LABELS = ("GVT", "1-MGVT")
# By algorithm and iteration: the share of the optimum in each bin.
Bins = Mapping[tuple[str, int], Sequence[Interval]]


def doors(experiment: Experiment) -> np.ndarray:
    """The place (R,) of each run's door in its wall."""
    return np.asarray(load(experiment, "tasks").doors[:, 0])


def likelihoods(experiment: Experiment) -> np.ndarray:
    """The likelihood (R,) of each run's door, over the largest."""
    mean, deviation = rooms.LIKELIHOOD_DOORS
    return np.asarray(np.exp(-0.5 * ((doors(experiment) - mean) / deviation) ** 2))


def bin_of(experiment: Experiment) -> np.ndarray:
    """The bin (R,) of each run."""
    return np.searchsorted(EDGES, likelihoods(experiment) - 1e-6)


def shares(stored: Dataset, t: int, chosen: np.ndarray) -> np.ndarray:
    """What the chosen runs earn while learning at an iteration, of their own optimum."""
    earned = np.asarray(stored.learning.sel(iteration=t) / stored.optimum)
    return np.asarray(earned[chosen])


def binned() -> dict[str, Bins]:
    """The bins of both protocols and of the published figure, by their names."""
    protocols = rooms.ROOMS_LIKELIHOOD._asdict()
    found: dict[str, Bins] = {name: _bins(e, LABELS) for name, e in protocols.items()}
    table, optimum = rows("rooms-likelihood"), _optimum(rooms.ROOMS_LIKELIHOOD.published)
    found["printed"] = {
        (label, t): [
            Interval(*(row[x] / best for x in ("mean", "low", "high")))
            for row, best in zip(
                table[(table["algorithm"] == label) & (table["iteration"] == t)],
                optimum,
                strict=True,
            )
        ]
        for label in LABELS
        for t in AT
    }
    return found


def _optimum(experiment: Experiment) -> list[float]:
    best, place = load(experiment, "tasks").optimum.values, bin_of(experiment)
    return [float(best[place == i].mean()) for i in range(len(EDGES))]


def _bins(experiment: Experiment, labels: Sequence[str]) -> Bins:
    place = bin_of(experiment)
    runs = {x: returns(experiment, x) for x in labels}
    return {
        (x, t): [mean_interval(shares(runs[x], t, place == i)) for i in range(5)]
        for x in labels
        for t in AT
    }
