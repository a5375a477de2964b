"""The book's experiments: a frozen configuration per figure; what runs, stores, verifies."""

from vtlib.experiments import cartpole, compared, maze, mountain_car, rooms
from vtlib.experiments.experiment import Experiment
from vtlib.experiments.heads import live_check
from vtlib.experiments.store import load, returns

__all__ = ["EXPERIMENTS", "POOLS", "THESIS", "live_check", "load", "named", "returns"]

# For the command line: an experiment of one's own runs, stores and verifies without it.
PAGES = (rooms, cartpole, mountain_car, maze, compared)
EXPERIMENTS: dict[str, Experiment] = {e.name: e for page in PAGES for e in page.EXPERIMENTS}
# The figures of the thesis, in both protocols; the others ask why.
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
THESIS = [e.name for protocols in FIGURES for e in protocols if e.name in EXPERIMENTS]
POOLS = {e.pool.name: e.pool for e in EXPERIMENTS.values()}


def named(name: str) -> Experiment:
    """The experiment of that name; ValueError names the known ones otherwise."""
    if name not in EXPERIMENTS:
        raise ValueError(f"unknown experiment {name!r}; known are {', '.join(EXPERIMENTS)}")
    return EXPERIMENTS[name]
