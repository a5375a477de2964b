"""What sources cost and what they save, in environment steps until a task is solved."""

from typing import NamedTuple

import numpy as np
from xarray import Dataset

from vtlab.stats import Interval, mean_interval

SOLVED = 0.9  # of the way from the floor to its own optimum a run has to earn


class Cost(NamedTuple):
    """Environment steps, and the number of tasks after which transfer has paid for its sources."""

    sources: float
    with_transfer: np.ndarray
    without: np.ndarray
    saved: Interval
    unsolved: int
    unsolved_without: int

    @property
    def tasks(self) -> float:
        """Tasks until the sources' steps are saved; infinite when nothing is."""
        saved = float(self.saved.centre)
        return self.sources / saved if saved > 0 else np.inf


def steps_to_solve(runs: Dataset, floor: float = 0.0) -> np.ndarray:
    """Steps (R,) until the learning return reaches nine tenths of the optimum, or NaN if never."""
    goal = floor + SOLVED * (runs.optimum - floor)
    reached = (runs.learning >= goal).transpose("run", "iteration").values
    at = runs.iteration.values[reached.argmax(1)].astype(float)
    return np.where(reached.any(1), at, np.nan)


def cost(
    sources: Dataset, used: int, transfer: Dataset, without: Dataset, floor: float = 0.0
) -> Cost:
    """The cost of an algorithm that transfers from so many of the pool's sources.

    Sources count with all their training, unsolved ones with all that they were allowed; what was
    played to check them is not counted.

    Runs that never solve their task count with all their steps, which understates what a method
    that solves them saves, and says little where both leave many unsolved.
    """
    pool, end = sources.attrs["config"], float(transfer.iteration[-1])
    spent = sources.iterations.where(sources.solved, pool["limit"] * pool.get("attempts", 1))
    with_transfer, alone = (steps_to_solve(x, floor) for x in (transfer, without))
    unsolved = [int(np.isnan(steps).sum()) for steps in (with_transfer, alone)]
    with_transfer, alone = (np.nan_to_num(steps, nan=end) for steps in (with_transfer, alone))
    saved = mean_interval(alone - with_transfer)
    return Cost(used * float(spent.mean()), with_transfer, alone, saved, *unsolved)
