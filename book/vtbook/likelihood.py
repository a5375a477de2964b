"""Returns by the likelihood of the task (section 6.1.4), in the published figure's five bins."""

from collections.abc import Mapping, Sequence

import numpy as np
from xarray import Dataset

from vtbook.experiments import rooms
from vtbook.published import rows
from vtlab.experiment import Experiment
from vtlab.stats import Interval, mean_interval
from vtlab.store import load, returns

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


def shares(experiment: Experiment, stored: Dataset, t: int, chosen: np.ndarray) -> np.ndarray:
    """What chosen runs (R,), which are whole doors, earn at an iteration, of their optimum (D,).

    Runs at one door share their task: only doors are independent of each other.
    """
    earned = (stored.learning.sel(iteration=t) / stored.optimum).values[chosen]
    return np.asarray(earned.reshape(-1, experiment.runs_per_task).mean(1))


def gap(experiment: Experiment, t: int) -> Interval:
    """GVT minus 1-MGVT in the lowest fifth, paired by door."""
    lowest = bin_of(experiment) == 0
    earned = (shares(experiment, returns(experiment, x), t, lowest) for x in LABELS)
    return mean_interval(np.subtract(*earned))


def printed(experiment: Experiment) -> Bins:
    """The published bins as shares of the mean optimum of our tasks in each."""
    best, place = load(experiment, "tasks").optimum.values, bin_of(experiment)
    bins: dict[tuple[str, int], list[Interval]] = {(x, t): [] for x in LABELS for t in AT}
    for row in rows("rooms-likelihood"):
        points = bins[row["algorithm"], row["iteration"]]
        optimum = best[place == len(points)].mean()
        points.append(Interval(*(row[x] / optimum for x in ("mean", "low", "high"))))
    return bins


def binned(experiment: Experiment) -> Bins:
    """What our runs earn in each bin."""
    place = bin_of(experiment)
    runs = {label: returns(experiment, label) for label in LABELS}
    return {
        (label, t): [
            mean_interval(shares(experiment, runs[label], t, place == i)) for i in range(len(EDGES))
        ]
        for label in LABELS
        for t in AT
    }
