"""What `vtlib.trust` learns with, one setting at a time, on tasks for tuning alone.

The runs are eight on the tuning tasks of both kinds of rooms in `compared`, on which nothing is
judged. Where sources keep their promise no change could tell.
"""

from typing import Any

from attrs import evolve

from vtbook.experiments.compared import ENVIRONMENTS, TUNING_RUNS
from vtbook.experiments.trust import ITERATIONS, OURS
from vtbook.neighbours import VariedTrust
from vtlab.experiment import Algorithm, Experiment
from vtlib.trust import NARROW, RANDOM, STEP, WORTH, Trust

CHOSEN = Trust()


def _with(random: float = RANDOM, **learner: Any) -> VariedTrust:
    return VariedTrust(random=random, learner=evolve(CHOSEN.in_units, **learner))


#: What is changed, one at a time.
CHANGES: dict[str, Algorithm] = {
    "2 updates": Trust(updates=2),
    "3 components": Trust(components=3),
    "no random actions": _with(random=0.0),
    "a tenth of the prior's strength": _with(lambda_=0.1 * WORTH * NARROW**2),
    "ten times the prior's strength": _with(lambda_=10 * WORTH * NARROW**2),
    "twice Adam's step": _with(alpha_mu=2 * STEP),
}


def _search(beside: Experiment, stream: str, variants: dict[str, Algorithm]) -> Experiment:
    name = beside.name.removesuffix("-tuning") + "-search"
    return evolve(
        beside,
        name=name,
        stream=stream,
        algorithms={OURS: CHOSEN, **variants},
        runs=TUNING_RUNS,
        iterations=ITERATIONS,
        every=100,
    )


SEARCH = {
    place.title: _search(place.tuning(), place.tuning().stream, CHANGES)
    for place in ENVIRONMENTS[:2]
}
