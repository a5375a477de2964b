"""What an experiment is: a frozen configuration of runs; and the sliders' settings around one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.domains import Family
from vtlib.sources import Pool
from vtlib.transfer import Settings

Algorithm = Settings | MellowTDSettings | DDQNSettings
ITERATIONS = 10_000


@dataclass(frozen=True)
class Experiment:
    """A figure's runs: targets from ``family``, ``sources`` of ``pool`` drawn for each run.

    Returns are recorded ``every`` so many of ``iterations``. Runs are seeded by ``stream``:
    experiments that share it share targets, sources and random numbers run by run. Each
    ``runs_per_task`` consecutive runs have one target. ``counts`` names algorithms that use only
    the first so many of a run's sources; ``excluded`` are sources that no run may draw; ``visits``
    keeps the positions that the agents visit; ``probes`` is the number of states and actions at
    which the posterior's coverage of the planned values is recorded.
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
        if not self.algorithms:
            raise ValueError(f"{self.name} has no algorithm")
        if not 1 <= self.sources <= len(self.eligible):
            raise ValueError(f"sources must lie in 1..{len(self.eligible)}, got {self.sources}")
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
    """Five powers of ten around the lambda of the thesis' setting."""
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
    """
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
