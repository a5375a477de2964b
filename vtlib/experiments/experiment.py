"""What an experiment is: a frozen configuration of runs; and the sliders' settings around one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.checks import check_kind, check_name, check_one_of, check_positive, check_whole, shown
from vtlib.domains import Family
from vtlib.sources import Pool
from vtlib.transfer import Settings

Algorithm = Settings | MellowTDSettings | DDQNSettings
ITERATIONS = 10_000
TASKS = "tasks"  # under this name an experiment's targets are stored, beside its algorithms


@dataclass(frozen=True)
class Experiment:
    """A figure's runs: targets from ``family``, ``sources`` of ``pool`` drawn for each run.

    Returns are recorded ``every`` so many of ``iterations``. Runs are seeded by ``stream``:
    experiments that share it share targets, sources and random numbers run by run. Each
    ``runs_per_task`` consecutive runs have one target. ``counts`` names algorithms that use only
    the first so many of a run's sources; ``excluded`` are sources that no run may draw; ``visits``
    keeps the positions that the agents visit; ``probes`` is the number of places at which
    the posterior is looked at along the way (see ``vtlib.experiments.probes``). Raises ValueError
    for a value outside its range.
    """

    name: str
    pool: Pool
    family: Family
    algorithms: Mapping[str, Algorithm]
    runs: int = 20
    sources: int = 10
    iterations: int = ITERATIONS
    every: int = 100
    stream: str = ""
    runs_per_task: int = 1
    counts: Mapping[str, int] = field(default_factory=dict)
    visits: bool = False
    excluded: tuple[int, ...] = ()
    probes: int = 0

    def __post_init__(self) -> None:
        check_name("name", self.name)
        check_kind("pool", self.pool, Pool)
        # sources are of use only to tasks with the same Q-function
        check_kind("family", self.family, type(self.pool.family))
        self._check_algorithms()
        for name in ("runs", "iterations", "runs_per_task"):
            check_whole(name, getattr(self, name))
        check_whole("every", self.every, 1, self.iterations)
        if self.runs % self.runs_per_task:
            raise ValueError(
                f"runs_per_task must divide the {self.runs} runs, got {self.runs_per_task}"
            )
        self._check_sources()
        check_kind("visits", self.visits, bool)
        self._check_probes()
        if self.stream == "":
            object.__setattr__(self, "stream", self.name)
        check_name("stream", self.stream)

    def _check_algorithms(self) -> None:
        check_kind("algorithms", self.algorithms, Mapping)
        if not self.algorithms:
            raise ValueError(f"algorithms must name at least one, got {shown(self.algorithms)}")
        for label, algorithm in self.algorithms.items():
            check_name("a label in algorithms", label)
            if label == TASKS:
                raise ValueError(f"algorithms must not be called {TASKS!r}, got {shown(label)}")
            check_kind(f"algorithms[{label!r}]", algorithm, Algorithm)

    def _check_sources(self) -> None:
        check_kind("excluded", self.excluded, tuple)
        for index in self.excluded:
            check_whole("excluded", index, 0, self.pool.count - 1)
        check_whole("sources", self.sources, 1, len(self.eligible))
        check_kind("counts", self.counts, Mapping)
        for label, count in self.counts.items():
            check_one_of("a label in counts", label, self.algorithms)
            check_whole(f"counts[{label!r}]", count, 1, self.sources)

    def _check_probes(self) -> None:
        check_whole("probes", self.probes, 0)
        transfers = all(isinstance(one, Settings) for one in self.algorithms.values())
        if self.probes and not transfers:
            raise ValueError(f"probes must be 0 unless all algorithms transfer, got {self.probes}")

    @property
    def eligible(self) -> list[int]:
        """Indices of the pool's sources that a run may draw."""
        return [i for i in range(self.pool.count) if i not in self.excluded]

    def task_of(self, run: int) -> int:
        """Number of the target task of a run."""
        return run // self.runs_per_task

    def transfer_settings(self, label: str) -> Settings:
        """The settings of an algorithm that transfers."""
        settings = self.algorithms[label]
        assert isinstance(settings, Settings), f"{label} does not transfer"
        return settings

    def sources_of(self, label: str) -> int:
        """How many of a run's sources an algorithm uses."""
        return self.counts.get(label, self.sources)


PSIS = (0.0, 0.5, 1.0)
COMPONENTS = (1, 2, 3)


def slider_lambdas(base: Settings) -> tuple[float, ...]:
    """Five powers of ten around the lambda of the thesis' setting, which must not be 0."""
    check_positive("lambda_", base.lambda_)
    middle = round(math.log10(base.lambda_))
    return tuple(float(f"1e{middle + step}") for step in (-2, -1, 0, 1, 2))


def slider_name(lambda_: float, psi: float, components: int) -> str:
    """The name under which one setting of the sliders is stored."""
    return f"{components}-MGVT-lambda-{lambda_:.0e}-psi-{psi:g}"


def sliders_of(
    experiment: Experiment,
    name: str,
    runs: int,
    iterations: int,
    lambdas: Sequence[float] | None = None,
    psis: Sequence[float] = PSIS,
    components: Sequence[int] = COMPONENTS,
) -> Experiment:
    """The settings of the sliders around 1-MGVT, on an experiment's first runs or tasks.

    lambdas, psis, components: those of the sliders; lambdas are ``slider_lambdas`` by default.
    Raises ValueError when the experiment has no 1-MGVT.
    """
    check_one_of("the sliders' algorithm", "1-MGVT", experiment.algorithms)
    base = experiment.transfer_settings("1-MGVT")
    return replace(
        experiment,
        name=name,
        algorithms={
            slider_name(lambda_, psi, c): replace(base, lambda_=lambda_, psi=psi, components=c)
            for c in reversed(components)
            for lambda_ in lambdas or slider_lambdas(base)
            for psi in psis
        },
        runs=runs,
        iterations=iterations,
        runs_per_task=1,
    )
