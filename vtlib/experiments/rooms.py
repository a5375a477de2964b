"""The rooms experiments (section 6.1) with the parameters of appendix A.1."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from vtlib.baselines import MellowTDSettings
from vtlib.envs.rooms import RoomsFamily
from vtlib.sources import Pool
from vtlib.transfer import Settings

Algorithm = Settings | MellowTDSettings

ITERATIONS = 10_000
# The thesis gives this schedule for the sources; its baseline only begins to learn at 7,000
# iterations, which is where this schedule ends.
NT = MellowTDSettings(epsilon_steps=7_000)
NT_FAST = MellowTDSettings(epsilon_steps=2_000)
GVT = Settings(family="gaussian", lambda_=1e-4)
MGVT = Settings(family="mixture", lambda_=1e-6)


@dataclass(frozen=True)
class Experiment:
    """A figure's runs: targets from ``family``, ``sources`` of ``pool`` drawn for each run.

    Returns are recorded ``every`` so many of ``iterations``. Runs are seeded by ``stream``:
    experiments that share it share targets, sources and random numbers run by run.
    """

    name: str
    pool: Pool
    family: RoomsFamily
    algorithms: Mapping[str, Algorithm]
    runs: int = 20
    sources: int = 10
    iterations: int = ITERATIONS
    every: int = 100
    stream: str = ""

    def __post_init__(self) -> None:
        if not self.algorithms:
            raise ValueError(f"{self.name} has no algorithm")
        if not 1 <= self.sources <= self.pool.count:
            raise ValueError(f"sources must lie in 1..{self.pool.count}, got {self.sources}")
        if not self.stream:
            object.__setattr__(self, "stream", self.name)


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

LAMBDAS = (1e-8, 1e-7, 1e-6, 1e-5, 1e-4)
PSIS = (0.0, 0.5, 1.0)
COMPONENTS = (1, 2, 3)


def slider_name(lambda_: float, psi: float, components: int) -> str:
    """The name under which one setting of the sliders is stored."""
    return f"{components}-MGVT-lambda-{lambda_:.0e}-psi-{psi:g}"


ROOMS_SLIDERS = Experiment(
    name="rooms-sliders",
    pool=THREE_ROOMS,
    family=RoomsFamily(rooms=3),
    algorithms={
        slider_name(lambda_, psi, c): replace(MGVT, lambda_=lambda_, psi=psi, components=c)
        for c in reversed(COMPONENTS)
        for lambda_ in LAMBDAS
        for psi in PSIS
    },
    runs=10,
    iterations=5_000,
    stream=ROOMS_EVALUATION.name,
)

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

EXPERIMENTS = {e.name: e for e in (ROOMS_EVALUATION, ROOMS_SLIDERS, ROOMS_CHANGE)}
POOLS = {e.pool.name: e.pool for e in EXPERIMENTS.values()}
