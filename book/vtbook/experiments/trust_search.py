"""What `vtlib.trust` learns with, one setting at a time, on tasks for tuning alone.

These are the choices that were open while the method was made. The runs are eight on the tuning
tasks of `compared`, on cartpoles of two wirings and in maze 0, on none of which anything is judged.
"""

from typing import Any

from attrs import evolve

from vtbook.experiments.compared import ENVIRONMENTS, TUNING_RUNS
from vtbook.experiments.maze import MAZE_TARGETS
from vtbook.experiments.trust import ITERATIONS, OURS, PLACES
from vtbook.neighbours import VariedTrust
from vtbook.neighbours.recommended import SHARE
from vtbook.stability import largest_step
from vtlab.experiment import Algorithm, Experiment
from vtlib.trust import NARROW, RANDOM, STEP, WORTH, Trust

CHOSEN = Trust()


def _with(random: float = RANDOM, **learner: Any) -> VariedTrust:
    return VariedTrust(random=random, learner=evolve(CHOSEN.in_units, **learner))


#: What is changed, one at a time.
CHANGES: dict[str, Algorithm] = {
    "2 updates": Trust(updates=2),
    "16 updates": Trust(updates=16),
    "3 components": Trust(components=3),
    "no random actions": _with(random=0.0),
    "a tenth of the prior's strength": _with(lambda_=0.1 * WORTH * NARROW**2),
    "ten times the prior's strength": _with(lambda_=10 * WORTH * NARROW**2),
    "a quarter of Adam's step": _with(alpha_mu=STEP / 4),
    "four times Adam's step": _with(alpha_mu=4 * STEP),
}


def _learned(d: int) -> VariedTrust:
    """Covariances that are learned, by steps on L of a quarter of the largest safe one."""
    return _with(covariance="full", alpha_L=SHARE * largest_step(d, CHOSEN.in_units.n_samples))


def _search(beside: Experiment, stream: str, variants: dict[str, Algorithm]) -> Experiment:
    name = beside.name.removesuffix("-tuning").removesuffix("-trust") + "-search"
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
    place.title: _search(
        place.tuning(),
        place.tuning().stream,
        {**CHANGES, "learned covariances": _learned(place.experiment.family.q().d)},
    )
    for place in ENVIRONMENTS[:2]
}
(_WIRED,) = (x.experiment for x in PLACES if x.title == "cartpole, two wirings")
SEARCH["cartpole, two wirings"] = _search(_WIRED, "wired-cartpole-tuning", CHANGES)
SEARCH["maze 0"] = _search(MAZE_TARGETS[0], "maze-0-search", CHANGES)
