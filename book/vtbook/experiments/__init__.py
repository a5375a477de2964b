"""The book's experiments: a frozen configuration per figure, offered to the command line."""

from vtbook.experiments import (
    cartpole,
    compared,
    controls,
    factorial,
    maze,
    mountain_car,
    prior_weight,
    recommended,
    rooms,
)
from vtlab.experiment import Experiment

__all__ = ["EXPERIMENTS", "POOLS", "THESIS"]

PAGES = (
    rooms,
    cartpole,
    mountain_car,
    maze,
    controls,
    prior_weight,
    compared,
    factorial,
    recommended,
)
EXPERIMENTS: dict[str, Experiment] = {e.name: e for page in PAGES for e in page.EXPERIMENTS}
POOLS = {e.pool.name: e.pool for e in EXPERIMENTS.values()}
FIGURES = (
    rooms.ROOMS_EVALUATION,
    rooms.ROOMS_CHANGE,
    rooms.ROOMS_EXPLORATION,
    rooms.ROOMS_LIKELIHOOD,
    rooms.ROOMS_SOURCES,
    cartpole.CARTPOLE,
    mountain_car.CAR,
    *maze.MAZE_TARGETS.values(),
)
# The figures of the thesis, in both protocols; the other experiments ask why.
THESIS = {e.name: e for protocols in FIGURES for e in protocols if e.name in EXPERIMENTS}
