"""The rooms experiments (section 6.1) with the parameters of appendix A.1."""

from __future__ import annotations

from dataclasses import replace

from vtlib.baselines import MellowTDSettings
from vtlib.envs.rooms import RoomsFamily
from vtlib.experiments.experiment import Experiment, sliders_of
from vtlib.sources import Pool
from vtlib.transfer import Settings

# The thesis gives this schedule for the sources; its baseline only begins to learn at 7,000
# iterations, which is where this schedule ends.
NT = MellowTDSettings(epsilon_steps=7_000)
NT_FAST = MellowTDSettings(epsilon_steps=2_000)
GVT = Settings(family="gaussian", lambda_=1e-4)
MGVT = Settings(family="mixture", lambda_=1e-6)

THREE_ROOMS = Pool("rooms-3-sources", RoomsFamily(rooms=3))

ROOMS_EVALUATION = Experiment(
    name="rooms-evaluation",
    pool=THREE_ROOMS,
    family=RoomsFamily(rooms=3),
    algorithms={
        "3-MGVT": replace(MGVT, components=3),
        "3-MGVT-mean": replace(MGVT, components=3, init="mean"),
        "GVT": GVT,
        "GVT-span": replace(GVT, init="span"),
        "1-MGVT": MGVT,
        "1-MGVT-mean": replace(MGVT, init="mean"),
        "NT": NT,
        "NT-fast": NT_FAST,
    },
)

ROOMS_CALIBRATION = replace(
    ROOMS_EVALUATION,
    name="rooms-calibration",
    algorithms={label: ROOMS_EVALUATION.algorithms[label] for label in ("3-MGVT", "GVT", "1-MGVT")},
    every=500,
    probes=500,
)

ROOMS_SLIDERS = sliders_of(ROOMS_EVALUATION, "rooms-sliders", 10, 5_000)

FIXED_LOWER = 5.0  # where the lower door of every source is, in section 6.1.2
ROOMS_CHANGE = Experiment(
    name="rooms-distribution-change",
    pool=Pool("rooms-3-fixed-lower-sources", RoomsFamily(rooms=3, fixed_lower=FIXED_LOWER)),
    family=RoomsFamily(rooms=3),
    algorithms={
        "3-MGVT": replace(MGVT, components=3),
        "GVT": GVT,
        "GVT-span": replace(GVT, init="span"),
        "1-MGVT": MGVT,
        "NT": NT,
    },
)

ROOMS_CHANGE_SLIDERS = sliders_of(ROOMS_CHANGE, "rooms-distribution-change-sliders", 10, 3_000)

TWO_ROOMS = Pool("rooms-2-sources", RoomsFamily(rooms=2))

ROOMS_EXPLORATION = Experiment(
    name="rooms-exploration",
    pool=TWO_ROOMS,
    family=RoomsFamily(rooms=2, fixed_lower=5.0),
    algorithms={
        "GVT": GVT,
        "GVT-span": replace(GVT, init="span"),
        "1-MGVT": MGVT,
        # the same share of the run as above
        "NT": replace(NT, epsilon_steps=1_400),
    },
    iterations=2_000,
    visits=True,
)

LIKELIHOOD_DOORS = (5.0, 1.8)  # mean and standard deviation of the door, in section 6.1.4
ROOMS_LIKELIHOOD = Experiment(
    name="rooms-likelihood",
    pool=Pool("rooms-2-normal-sources", RoomsFamily(rooms=2, normal=LIKELIHOOD_DOORS)),
    family=RoomsFamily(rooms=2, normal=LIKELIHOOD_DOORS),
    algorithms={"GVT": GVT, "1-MGVT": MGVT},
    runs=400,
    runs_per_task=20,
    iterations=4_000,
)
ROOMS_LIKELIHOOD_SLIDERS = sliders_of(ROOMS_LIKELIHOOD, "rooms-likelihood-sliders", 20, 1_000)

ROOMS_LIKELIHOOD_STARTS = replace(
    ROOMS_LIKELIHOOD,
    name="rooms-likelihood-starts",
    algorithms={
        "GVT-span": replace(GVT, init="span"),
        "1-MGVT-mean": replace(MGVT, init="mean"),
    },
    runs=100,
    runs_per_task=5,
)

SOURCE_COUNTS = tuple(range(2, 11))


def count_name(algorithm: str, count: int) -> str:
    """The name under which an algorithm with so many sources is stored."""
    return f"{algorithm}-from-{count}"


COUNTED = {
    "2-MGVT": replace(MGVT, components=2),
    "GVT": GVT,
    "GVT-span": replace(GVT, init="span"),
    "1-MGVT": MGVT,
    "1-MGVT-mean": replace(MGVT, init="mean"),
}
ROOMS_SOURCES = Experiment(
    name="rooms-number-of-sources",
    pool=TWO_ROOMS,
    family=RoomsFamily(rooms=2),
    algorithms={count_name(a, n): COUNTED[a] for a in COUNTED for n in SOURCE_COUNTS},
    counts={count_name(a, n): n for a in COUNTED for n in SOURCE_COUNTS},
    iterations=1_950,
    every=50,
)
