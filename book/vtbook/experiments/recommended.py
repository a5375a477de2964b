"""The recommended method on the tasks that it is judged on, and without one of its parts.

Its runs share tasks, sources and random numbers with those of the algorithms beside it: where these
were tuned, with the tuned ones (``compared``), elsewhere with those of the page.
"""

from __future__ import annotations

from typing import Any

from attrs import evolve

from vtbook.experiments.compared import ENVIRONMENTS
from vtbook.experiments.maze import MAIN, MAZE_TARGETS
from vtbook.experiments.mountain_car import CAR
from vtbook.neighbours.repeated import RepeatedTuning
from vtlib.baselines import FineTuning
from vtlib.experiments.experiment import Algorithm, Experiment
from vtlib.recommended import Recommended

OURS = "recommended"
CAR_ITERATIONS, MAZE_ITERATIONS = 5_000, 3_000  # the pages' runs are longer


def _tuned(experiment: Experiment) -> Experiment:
    """Beside tuned algorithms; where tasks are like the sources', also without one of its parts."""
    tuning, ours = experiment.algorithms["fine-tuned"], Recommended()
    assert isinstance(tuning, FineTuning)
    parts: dict[str, Algorithm] = {
        "one component": evolve(ours, components=1),
        "one update": evolve(ours, updates=1),
        "fine-tuned, as many updates": RepeatedTuning(tuning, ours.updates),
    }
    alike = not experiment.name.startswith("rooms-distribution-change")
    return _beside(experiment, algorithms={OURS: ours, **(parts if alike else {})})


def _beside(experiment: Experiment, **fields: Any) -> Experiment:
    """The same tasks and random numbers, under a name of its own."""
    name = f"{experiment.name.removesuffix('-compared')}-recommended"
    return evolve(experiment, name=name, stream=experiment.stream, **fields)


def _long(experiment: Experiment, iterations: int) -> Experiment:
    return _beside(experiment, algorithms={OURS: Recommended()}, iterations=iterations)


TUNED = tuple(_tuned(one.judged()) for one in ENVIRONMENTS)
MOUNTAIN_CAR = _long(CAR.published, CAR_ITERATIONS)
MAZE = _long(MAZE_TARGETS[MAIN].published, MAZE_ITERATIONS)
EXPERIMENTS = (*TUNED, MOUNTAIN_CAR, MAZE)
