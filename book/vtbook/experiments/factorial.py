"""What each part of 1-MGVT carries in three rooms: all its parts, in all combinations.

The settings are those that tuning has chosen for 1-MGVT. From them depart the start, the weight of
the prior, the posterior, the number of its components, and the operator; nothing is tuned again.
"""

import itertools
from typing import Any

import numpy as np
from attrs import asdict, evolve

from vtbook.experiments.compared import ENVIRONMENTS
from vtbook.experiments.controls import POINT
from vtbook.experiments.protocols import transfer_settings
from vtbook.neighbours import UnstartedSettings
from vtlab.experiment import Algorithm

ROOMS, RUNS = ENVIRONMENTS[0], 20
STARTS = ("nothing", "sources", "mean")
WEIGHTS = ("free", "held")  # by the divergence, or not at all
# samples that hardly differ, or the covariance and the number of components
POSTERIORS = ("point", "diagonal 1", "full 1", "diagonal 3", "full 3")
OPERATORS = {"max": 1e4, "mellow": 100.0}  # kappa; mellowmax is above max - log(4) / kappa

#: Each part: how the names of combinations with it differ from those without.
PARTS = {
    "start at sources, not at nothing": ("nothing", "sources"),
    "start at their mean, not at single ones": ("sources", "mean"),
    "held by the prior, not free": (", free", ", held"),
    "a posterior, not a point": ("point", "full 1"),
    "a full covariance, not a diagonal": ("diagonal", "full"),
    "three components, not one": (" 1,", " 3,"),
    "the mellow operator, not the maximum": (", max", ", mellow"),
}


def algorithm(start: str, weight: str, posterior: str, operator: str) -> Algorithm:
    """The algorithm of a combination."""
    tuned = transfer_settings(ROOMS.judged(), "1-MGVT")
    lambda_ = tuned.lambda_ if weight == "held" else 0.0
    changes: dict[str, Any] = {"kappa": OPERATORS[operator], "lambda_": lambda_}
    if posterior == "point":
        # lambda / sigma^2, the weight of the prior on the mean, stays
        changes["lambda_"] *= POINT**2 / tuned.sigma_p2
        changes |= {"sigma_p2": POINT**2, "covariance": "fixed"}
    else:
        covariance, components = posterior.split()
        changes |= {"covariance": covariance, "components": int(components)}
    if start == "nothing":
        settings = asdict(evolve(tuned, **changes))
        return UnstartedSettings(**settings, scale=ROOMS.experiment.family.scale)
    return evolve(tuned, init=start, **changes)


NAME = f"{ROOMS.experiment.name}-factorial"
FACTORIAL = evolve(
    ROOMS.judged(),
    name=NAME,
    stream=NAME,
    algorithms={
        ", ".join(parts): algorithm(*parts)
        for parts in itertools.product(STARTS, WEIGHTS, POSTERIORS, OPERATORS)
    },
    runs=RUNS,
)


def effects(part: str, *others: str) -> np.ndarray:
    """What a part adds to the share of the optimum (N, R), in all N combinations with some others.

    Only the part that is a start is compared with the start from nothing, where nothing else adds.
    """
    without, present = PARTS[part]
    pairs = [
        (x, x.replace(without, present))
        for x in FACTORIAL.algorithms
        if without in x
        and all(other in x for other in others)
        and (without == STARTS[0] or not x.startswith(STARTS[0]))
    ]
    return np.stack([ROOMS.earned(FACTORIAL, b) - ROOMS.earned(FACTORIAL, a) for a, b in pairs])
