"""What each part of 1-MGVT carries in three rooms: all its parts, in all combinations.

The settings are those that tuning has chosen for 1-MGVT. From them depart the start, the posterior,
the number of its components, and the operator; nothing is tuned again.
"""

import itertools

import numpy as np
from attrs import asdict, evolve

from vtbook.experiments.compared import ENVIRONMENTS
from vtbook.experiments.protocols import transfer_settings
from vtbook.neighbours import UnstartedSettings
from vtlab.experiment import Algorithm
from vtlib.baselines import FineTuning, MellowTDSettings

ROOMS, RUNS = ENVIRONMENTS[0], 20
STARTS = ("nothing", "sources", "mean")
# no posterior, or its covariance and the number of its components
POSTERIORS = ("point", "diagonal 1", "full 1", "diagonal 3", "full 3")
OPERATORS = {"max": 1e4, "mellow": 100.0}  # kappa; mellowmax is above max - log(4) / kappa

#: Each part: how the names of combinations with it differ from those without.
PARTS = {
    "start at sources, not at nothing": ("nothing", "sources"),
    "start at their mean, not at single ones": ("sources", "mean"),
    "a posterior, not a point": ("point", "full 1"),
    "a full covariance, not a diagonal": ("diagonal", "full"),
    "three components, not one": (" 1,", " 3,"),
    "the mellow operator, not the maximum": (", max", ", mellow"),
}


def algorithm(start: str, posterior: str, operator: str) -> Algorithm:
    """The algorithm of a combination."""
    tuned = transfer_settings(ROOMS.judged(), "1-MGVT")
    kappa = OPERATORS[operator]
    if posterior == "point":
        learner = MellowTDSettings(
            epsilon_steps=1,
            epsilon_start=0.02,
            alpha=tuned.alpha_mu,
            **{x: getattr(tuned, x) for x in ("psi", "gamma", "minibatch", "buffer")},
            kappa=kappa,
        )
        if start == "nothing":
            return learner
        return FineTuning(learner, "one" if start == "sources" else "mean")
    covariance, components = posterior.split()
    chosen = evolve(tuned, kappa=kappa, covariance=covariance, components=int(components))
    if start == "nothing":
        return UnstartedSettings(**asdict(chosen), scale=ROOMS.experiment.family.scale)
    return evolve(chosen, init=start)


NAME = f"{ROOMS.experiment.name}-factorial"
FACTORIAL = evolve(
    ROOMS.judged(),
    name=NAME,
    stream=NAME,
    algorithms={
        ", ".join(parts): algorithm(*parts)
        for parts in itertools.product(STARTS, POSTERIORS, OPERATORS)
    },
    runs=RUNS,
)


def effects(part: str) -> np.ndarray:
    """What a part adds to the share of the optimum (N, R), in all N combinations of the others."""
    without, present = PARTS[part]
    pairs = [(x, x.replace(without, present)) for x in FACTORIAL.algorithms if without in x]
    return np.stack([ROOMS.earned(FACTORIAL, b) - ROOMS.earned(FACTORIAL, a) for a, b in pairs])
