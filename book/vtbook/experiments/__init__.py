"""The book's experiments: a frozen configuration per figure, offered to the command line."""

from collections.abc import Iterator, Mapping

from vtbook.experiments import (
    cartpole,
    compared,
    controls,
    factorial,
    maze,
    mountain_car,
    prior_weight,
    rooms,
    trust,
    trust_parts,
    trust_search,
)
from vtlab.experiment import Experiment

PAGES = (
    *(rooms, cartpole, mountain_car, maze),
    *(controls, prior_weight, compared, factorial, trust, trust_parts, trust_search),
)


def experiments_in(value: object) -> Iterator[Experiment]:
    """An experiment itself, or all those in a tuple or a dictionary."""
    if isinstance(value, Experiment):
        yield value
    elif isinstance(value, tuple | Mapping):
        for part in value.values() if isinstance(value, Mapping) else value:
            yield from experiments_in(part)


# Whatever a file names without an underscore.
EXPERIMENTS: dict[str, Experiment] = {
    experiment.name: experiment
    for page in PAGES
    for name, value in vars(page).items()
    if not name.startswith("_")
    for experiment in experiments_in(value)
}
POOLS = {e.pool.name: e.pool for e in EXPERIMENTS.values()}
# The figures of the thesis; the other experiments ask why.
THESIS: dict[str, Experiment] = {
    figure.name: figure
    for figure in (
        rooms.ROOMS_EVALUATION,
        rooms.ROOMS_CHANGE,
        rooms.ROOMS_EXPLORATION,
        rooms.ROOMS_LIKELIHOOD,
        rooms.ROOMS_SOURCES,
        cartpole.CARTPOLE,
        mountain_car.CAR,
        *maze.MAZE_TARGETS.values(),
    )
}
