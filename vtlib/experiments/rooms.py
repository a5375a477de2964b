"""The rooms experiments (section 6.1) with the parameters of appendix A.1."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

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
    experiments that share it share targets, sources and random numbers run by run. Each
    ``runs_per_task`` consecutive runs have one target. ``counts`` names algorithms that use only
    the first so many of a run's sources; ``visits`` keeps the positions that the agents visit.
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
    runs_per_task: int = 1
    counts: Mapping[str, int] = field(default_factory=dict)
    visits: bool = False

    def __post_init__(self) -> None:
        if not self.algorithms:
            raise ValueError(f"{self.name} has no algorithm")
        if not 1 <= self.sources <= self.pool.count:
            raise ValueError(f"sources must lie in 1..{self.pool.count}, got {self.sources}")
        for label, count in self.counts.items():
            if label not in self.algorithms or not 1 <= count <= self.sources:
                raise ValueError(
                    f"counts must give algorithms 1..{self.sources} sources, got {label}: {count}"
                )
        if self.runs_per_task < 1 or self.runs % self.runs_per_task:
            raise ValueError(
                f"runs_per_task must divide the {self.runs} runs, got {self.runs_per_task}"
            )
        if not self.stream:
            object.__setattr__(self, "stream", self.name)

    def task_of(self, run: int) -> int:
        """Number of the target task of a run."""
        return run // self.runs_per_task

    def sources_of(self, label: str) -> int:
        """How many of a run's sources an algorithm uses."""
        return self.counts.get(label, self.sources)


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


def sliders_of(experiment: Experiment, name: str, runs: int, iterations: int) -> Experiment:
    """The settings of the sliders, on the first runs or tasks of an experiment."""
    return replace(
        experiment,
        name=name,
        algorithms={
            slider_name(lambda_, psi, c): replace(MGVT, lambda_=lambda_, psi=psi, components=c)
            for c in reversed(COMPONENTS)
            for lambda_ in LAMBDAS
            for psi in PSIS
        },
        runs=runs,
        iterations=iterations,
        runs_per_task=1,
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

EXPERIMENTS = {
    e.name: e
    for e in (
        ROOMS_EVALUATION,
        ROOMS_SLIDERS,
        ROOMS_CHANGE,
        ROOMS_EXPLORATION,
    )
}
POOLS = {e.pool.name: e.pool for e in EXPERIMENTS.values()}
