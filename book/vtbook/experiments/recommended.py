"""The recommended method on the tasks that it is judged on, and without one of its parts.

Its runs share tasks, sources and random numbers with those of the algorithms beside it: where these
were tuned, with the tuned ones (``compared``), elsewhere with those of the page.
"""

from typing import Any

from attrs import evolve

from vtbook.experiments.compared import ENVIRONMENTS
from vtbook.experiments.mountain_car import CAR
from vtbook.neighbours import Recommended, RepeatedSettings, UntouchedSettings
from vtlab.experiment import Algorithm, Experiment
from vtlib.baselines import FineTuning

OURS = "recommended"
CAR_ITERATIONS = 5_000  # the page's runs are longer


def _beside(experiment: Experiment, **fields: Any) -> Experiment:
    """The method on the same tasks with the same random numbers, under a name of its own."""
    name = f"{experiment.name.removesuffix('-compared')}-recommended"
    fields = {"name": name, "algorithms": {OURS: Recommended()}, **fields}
    return evolve(experiment, stream=experiment.stream, **fields)


def _in_parts(experiment: Experiment, **fields: Any) -> Experiment:
    """Also without one of its parts, and a learner alone with as many updates."""
    tuning, ours = experiment.algorithms["fine-tuned"], Recommended()
    assert isinstance(tuning, FineTuning)
    algorithms: dict[str, Algorithm] = {
        OURS: ours,
        "one component": evolve(ours, components=1),
        "one update": evolve(ours, updates=1),
        "fine-tuned, as many updates": RepeatedSettings(tuning, ours.updates),
    }
    return _beside(experiment, algorithms=algorithms, **fields)


ROOMS, CHANGED, POLES, CARS = (place.judged() for place in ENVIRONMENTS)
TUNED = (
    _in_parts(ROOMS),
    _beside(CHANGED),
    _in_parts(POLES),
    _in_parts(CARS, name=f"{CARS.name}-recommended"),  # the other name is the page's cars'
)
MOUNTAIN_CAR = _beside(
    CAR.published,
    iterations=CAR_ITERATIONS,
    algorithms={OURS: Recommended(), "untouched": UntouchedSettings()},
)
