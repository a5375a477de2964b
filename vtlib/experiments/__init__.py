"""The book's experiments: a frozen configuration per figure; what runs, stores, verifies."""

from vtlib.experiments.control import (
    CAR,
    CAR_SLIDERS,
    CARTPOLE,
    CARTPOLE_COLLAPSE,
    CARTPOLE_LATE,
    CARTPOLE_LATE_AGAIN,
    CARTPOLE_OTHER_SOURCES,
    CARTPOLE_SLIDERS,
)
from vtlib.experiments.deviations import ROOMS_CORNER, ROOMS_DEVIATIONS
from vtlib.experiments.experiment import Experiment
from vtlib.experiments.mazes import MAZE_SLIDERS, MAZE_TARGETS
from vtlib.experiments.rooms import (
    ROOMS_CALIBRATION,
    ROOMS_CHANGE,
    ROOMS_CHANGE_SLIDERS,
    ROOMS_EVALUATION,
    ROOMS_EXPLORATION,
    ROOMS_LIKELIHOOD,
    ROOMS_LIKELIHOOD_SLIDERS,
    ROOMS_LIKELIHOOD_STARTS,
    ROOMS_SLIDERS,
    ROOMS_SOURCES,
)

__all__ = [
    "CAR",
    "CARTPOLE",
    "CARTPOLE_COLLAPSE",
    "CARTPOLE_LATE",
    "CARTPOLE_LATE_AGAIN",
    "CARTPOLE_OTHER_SOURCES",
    "CARTPOLE_SLIDERS",
    "CAR_SLIDERS",
    "EXPERIMENTS",
    "MAZE_SLIDERS",
    "MAZE_TARGETS",
    "POOLS",
    "ROOMS_CALIBRATION",
    "ROOMS_CHANGE",
    "ROOMS_CHANGE_SLIDERS",
    "ROOMS_CORNER",
    "ROOMS_DEVIATIONS",
    "ROOMS_EVALUATION",
    "ROOMS_EXPLORATION",
    "ROOMS_LIKELIHOOD",
    "ROOMS_LIKELIHOOD_SLIDERS",
    "ROOMS_LIKELIHOOD_STARTS",
    "ROOMS_SLIDERS",
    "ROOMS_SOURCES",
    "Experiment",
    "named",
]

EXPERIMENTS = {
    e.name: e
    for e in (
        ROOMS_EVALUATION,
        ROOMS_SLIDERS,
        ROOMS_CHANGE,
        ROOMS_CHANGE_SLIDERS,
        ROOMS_EXPLORATION,
        ROOMS_LIKELIHOOD,
        ROOMS_LIKELIHOOD_SLIDERS,
        ROOMS_LIKELIHOOD_STARTS,
        ROOMS_SOURCES,
        CARTPOLE,
        CARTPOLE_SLIDERS,
        *CARTPOLE_OTHER_SOURCES.values(),
        CARTPOLE_COLLAPSE,
        CARTPOLE_LATE,
        CARTPOLE_LATE_AGAIN,
        CAR,
        CAR_SLIDERS,
        *MAZE_TARGETS.values(),
        MAZE_SLIDERS,
        ROOMS_CALIBRATION,
        ROOMS_DEVIATIONS,
        ROOMS_CORNER,
    )
}
POOLS = {e.pool.name: e.pool for e in EXPERIMENTS.values()}


def named(name: str) -> Experiment:
    """The experiment of that name; ValueError names the known ones otherwise."""
    if name not in EXPERIMENTS:
        raise ValueError(f"unknown experiment {name!r}; known are {', '.join(EXPERIMENTS)}")
    return EXPERIMENTS[name]
