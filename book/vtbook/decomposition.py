"""What each part of the method adds to what it earns: its lead over fine-tuning, part by part."""

import numpy as np

from vtbook.claims import Runs
from vtbook.experiments.protocols import FROM_MEAN
from vtlab.experiment import Experiment

#: Each part, and the labels of the controls without it and with it.
PARTS = {
    "another learner": (FROM_MEAN, "1-MGVT, start alone"),
    "weight of the prior": ("1-MGVT, start alone", "1-MGVT, point"),
    "spread of the samples": ("1-MGVT, point", "1-MGVT, frozen"),
    "learned covariance": ("1-MGVT, frozen", "1-MGVT"),
}


def course(experiment: Experiment, label: str) -> np.ndarray:
    """The learning return of independent tasks (U,), as a share, averaged over the whole course.

    Where several runs have one task, the task is the unit, and its runs are averaged.
    """
    return _by_task(experiment, Runs.of(experiment, label).shares_until(experiment.iterations))


def at_end(experiment: Experiment, label: str, other: str) -> np.ndarray:
    """How much more an algorithm earns than another at the end, on the same tasks (U,)."""
    first, second = (Runs.of(experiment, x).shares(experiment.iterations) for x in (label, other))
    return _by_task(experiment, first - second)


def _by_task(experiment: Experiment, values: np.ndarray) -> np.ndarray:
    return np.asarray(values.reshape(-1, experiment.runs_per_task).mean(1))


def difference(experiment: Experiment, label: str, other: str) -> np.ndarray:
    """How much more an algorithm earns over the course than another, on the same tasks (U,)."""
    gain: np.ndarray = course(experiment, label) - course(experiment, other)
    return gain


def lead_by_part(experiment: Experiment) -> dict[str, np.ndarray]:
    """The lead of 1-MGVT over fine-tuning of the mean (U,), and what each part adds to it."""
    parts = {part: difference(experiment, *labels[::-1]) for part, labels in PARTS.items()}
    return {"the lead": difference(experiment, "1-MGVT", FROM_MEAN), **parts}
