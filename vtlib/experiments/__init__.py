"""The book's experiments: a frozen configuration per figure; what runs, stores, verifies."""

from vtlib.experiments.rooms import (
    EXPERIMENTS,
    POOLS,
    ROOMS_CHANGE,
    ROOMS_CHANGE_SLIDERS,
    ROOMS_EVALUATION,
    ROOMS_EXPLORATION,
    ROOMS_LIKELIHOOD,
    ROOMS_LIKELIHOOD_SLIDERS,
    ROOMS_SLIDERS,
    ROOMS_SOURCES,
    Experiment,
)

__all__ = [
    "EXPERIMENTS",
    "POOLS",
    "ROOMS_CHANGE",
    "ROOMS_CHANGE_SLIDERS",
    "ROOMS_EVALUATION",
    "ROOMS_EXPLORATION",
    "ROOMS_LIKELIHOOD",
    "ROOMS_LIKELIHOOD_SLIDERS",
    "ROOMS_SLIDERS",
    "ROOMS_SOURCES",
    "Experiment",
    "named",
]


def named(name: str) -> Experiment:
    """The experiment of that name; ValueError names the known ones otherwise."""
    if name not in EXPERIMENTS:
        raise ValueError(f"unknown experiment {name!r}; known are {', '.join(EXPERIMENTS)}")
    return EXPERIMENTS[name]
