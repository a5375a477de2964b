"""The rooms experiments (section 6.1) with the parameters of appendix A.1, as published."""

from collections.abc import Sequence
from typing import Any

from attrs import evolve

from vtbook.experiments.grids import count_name, sliders_of
from vtbook.experiments.protocols import (
    FINE_TUNED,
    as_published,
    fine_tuning,
    one_at_a_time,
    transfer,
)
from vtbook.probes import CoverageProbe
from vtlab.envs.rooms import RoomsFamily
from vtlab.experiment import Algorithm, Experiment, Pool
from vtlib.baselines import MellowTDSettings
from vtlib.transfer import Settings

ITERATIONS = 20_000
PUBLISHED_BUFFER = 50_000
NT = MellowTDSettings(epsilon_steps=14_000)
GVT = Settings(family="gaussian", lambda_=1e-4)
MGVT = Settings(family="mixture", lambda_=1e-6)
PUBLISHED_GVT = evolve(as_published(GVT), lambda_=1e-3, buffer=PUBLISHED_BUFFER)
PUBLISHED_MGVT = evolve(as_published(MGVT), buffer=PUBLISHED_BUFFER)


def _figure(
    name: str,
    pool: Pool,
    family: RoomsFamily,
    *counts: int,
    nt: MellowTDSettings = NT,
    **fields: Any,
) -> Experiment:
    """An experiment as published, with mixtures of so many components, and with fine-tuning."""
    return Experiment(
        name,
        pool,
        family,
        {**transfer(PUBLISHED_GVT, PUBLISHED_MGVT, counts), "NT": nt, **fine_tuning(nt)},
        each=True,
        **{"iterations": ITERATIONS, **fields},
    )


THREE_ROOMS = Pool("rooms-3-sources", RoomsFamily(rooms=3))
ROOMS_EVALUATION = _figure("rooms-evaluation", THREE_ROOMS, RoomsFamily(rooms=3), 3)
# By the equations the frontier of the rooms, along which agents slide otherwise, stops them.
STOPPING = RoomsFamily(rooms=3, stops=True)
ROOMS_EVALUATION_EQUATIONS = evolve(
    ROOMS_EVALUATION,
    name="rooms-evaluation-equations",
    pool=evolve(THREE_ROOMS, name="rooms-3-sources-equations", family=STOPPING),
    family=STOPPING,
    algorithms={**transfer(GVT, MGVT), "NT": NT},
    each=False,
)

PUBLISHED: dict[str, Algorithm] = {"GVT": PUBLISHED_GVT, "1-MGVT": PUBLISHED_MGVT}

# Half as far as the figure: the thesis compares GVT and 1-MGVT at 5,000 iterations.
INGREDIENT_ITERATIONS = 5_000
# From the published settings to those of the equations, one ingredient at a time; and one lambda.
ROOMS_INGREDIENTS = evolve(
    ROOMS_EVALUATION,
    name="rooms-ingredients",
    algorithms={
        **PUBLISHED,
        **one_at_a_time(PUBLISHED_GVT, PUBLISHED_MGVT),
        "GVT, lambda 1e-4": evolve(PUBLISHED_GVT, lambda_=GVT.lambda_),
        "GVT, lambda 1e-6": evolve(PUBLISHED_GVT, lambda_=MGVT.lambda_),
        "GVT, from the prior, no clip": evolve(PUBLISHED_GVT, init="sources", kl_clip=None),
        "1-MGVT, lambda 1e-3": evolve(PUBLISHED_MGVT, lambda_=PUBLISHED_GVT.lambda_),
    },
    iterations=INGREDIENT_ITERATIONS,
)
# What remains of the published code's choices, and of numbers that the text leaves open.
ROOMS_DEVIATIONS = evolve(
    ROOMS_INGREDIENTS,
    name="rooms-deviations",
    algorithms={
        "GVT, diagonal KL": evolve(PUBLISHED_GVT, kl="diagonal"),
        "GVT, jitter 1e-6": evolve(PUBLISHED_GVT, jitter=1e-6),
        "GVT, jitter 1e-2": evolve(PUBLISHED_GVT, jitter=1e-2),
        "GVT, no clip at all": evolve(PUBLISHED_GVT, clip=None, kl_clip=None),
        "1-MGVT, no clip at all": evolve(PUBLISHED_MGVT, clip=None),
        "GVT, by the episode": evolve(PUBLISHED_GVT, act="episode"),
        "1-MGVT, by the episode": evolve(PUBLISHED_MGVT, act="episode"),
    },
)
# The same with the frontier of the text, with sources that were solved at such a frontier, and with
# sources that start where targets do.
ROOMS_FRONTIER = evolve(
    ROOMS_INGREDIENTS,
    name="rooms-frontier",
    family=STOPPING,
    algorithms=PUBLISHED,
)
ROOMS_RETRAINED = evolve(
    ROOMS_FRONTIER,
    name="rooms-frontier-sources",
    pool=ROOMS_EVALUATION_EQUATIONS.pool,
    family=THREE_ROOMS.family,
)
ROOMS_CORNER = evolve(
    ROOMS_FRONTIER,
    name="rooms-corner-sources",
    family=THREE_ROOMS.family,
    # from the corner chance rarely leads to the goal: these count as they are
    pool=evolve(
        THREE_ROOMS,
        name="rooms-3-corner-sources",
        limit=THREE_ROOMS.iterations,
        as_targets=True,
    ),
)

FIXED_LOWER = 5.0  # where the lower door of every source is, in section 6.1.2
ROOMS_CHANGE = _figure(
    "rooms-distribution-change",
    Pool("rooms-3-fixed-lower-sources", RoomsFamily(rooms=3, fixed_lower=FIXED_LOWER)),
    RoomsFamily(rooms=3),
    3,
)
TWO_ROOMS = Pool("rooms-2-sources", RoomsFamily(rooms=2))
ROOMS_EXPLORATION = _figure(
    "rooms-exploration",
    TWO_ROOMS,
    RoomsFamily(rooms=2, fixed_lower=5.0),
    # NT explores for the same share of the run as above
    nt=evolve(NT, epsilon_steps=1_400),
    iterations=2_000,
    visits=True,
)

LIKELIHOOD_DOORS = (5.0, 1.8)  # mean and standard deviation of the door, in section 6.1.4
# The published targets are no draws: their doors are half a unit apart.
ROOMS_LIKELIHOOD = _figure(
    "rooms-likelihood",
    Pool("rooms-2-normal-sources", RoomsFamily(rooms=2, normal=LIKELIHOOD_DOORS)),
    RoomsFamily(rooms=2, ladder=19),
    runs=380,
    runs_per_task=20,
    iterations=4_000,
)

SOURCE_COUNTS = tuple(range(2, 11))


def _by_count(experiment: Experiment, numbers: Sequence[int] = SOURCE_COUNTS) -> Experiment:
    """Every algorithm that knows how many sources there are, with each number of them."""
    counted = {
        label: algorithm
        for label, algorithm in experiment.algorithms.items()
        if algorithm.transfers and label != FINE_TUNED  # of one source
    }
    return evolve(
        experiment,
        algorithms={count_name(x, n): counted[x] for x in counted for n in numbers},
        counts={count_name(x, n): n for x in counted for n in numbers},
    )


_COUNTED = _figure(
    "rooms-number-of-sources", TWO_ROOMS, RoomsFamily(rooms=2), 2, iterations=1_950, every=50
)
ROOMS_SOURCES = _by_count(_COUNTED)
# GVT held as loosely as 1-MGVT, by the weight of its prior, lambda / sigma^2.
ROOMS_SOURCES_LOOSE = _by_count(
    evolve(
        _COUNTED,
        name="rooms-number-of-sources-loose",
        algorithms={"GVT": evolve(PUBLISHED_GVT, lambda_=1e-5)},
    ),
    (2, 10),
)

# The published lambda of mixtures and that of GVT, the text's between them, and one on each side.
ROOMS_LAMBDAS = (1e-8, 1e-6, 1e-4, 1e-3, 1e-2)
ROOMS_EVALUATION_SLIDERS = sliders_of(
    ROOMS_EVALUATION, "rooms-evaluation-sliders", 10, 3_000, ROOMS_LAMBDAS
)

ROOMS_CALIBRATION = evolve(
    ROOMS_EVALUATION,
    name="rooms-calibration",
    algorithms={
        "GVT": PUBLISHED_GVT,
        "GVT, lambda 1e-6": evolve(PUBLISHED_GVT, lambda_=MGVT.lambda_),
        "1-MGVT": PUBLISHED_MGVT,
    },
    iterations=10_000,
    every=500,
    probes=500,
    probe=CoverageProbe,
)
