"""The book's experiments: a frozen configuration per figure; what runs, stores, verifies."""

from vtlib.experiments import cartpole, maze, mountain_car, rooms
from vtlib.experiments.check import live_check
from vtlib.experiments.experiment import Experiment
from vtlib.experiments.store import load, returns

__all__ = ["EXPERIMENTS", "POOLS", "live_check", "load", "named", "returns"]

# For the command line: an experiment of one's own runs, stores and verifies without it.
PAGES = (rooms.EXPERIMENTS, cartpole.EXPERIMENTS, mountain_car.EXPERIMENTS, maze.EXPERIMENTS)
EXPERIMENTS: dict[str, Experiment] = {e.name: e for page in PAGES for e in page}
POOLS = {e.pool.name: e.pool for e in EXPERIMENTS.values()}


def named(name: str) -> Experiment:
    """The experiment of that name; ValueError names the known ones otherwise."""
    if name not in EXPERIMENTS:
        raise ValueError(f"unknown experiment {name!r}; known are {', '.join(EXPERIMENTS)}")
    return EXPERIMENTS[name]
