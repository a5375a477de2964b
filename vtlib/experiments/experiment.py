"""What an experiment is: frozen configurations of source pools and of runs; and the sliders."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import ClassVar, Protocol, runtime_checkable

import attrs
from attrs import Factory, evolve, field, frozen
from torch import Tensor

from vtlib import checks
from vtlib.baselines import MellowTDSettings
from vtlib.checks import check_kind, check_name, check_one_of, check_positive, check_whole, shown
from vtlib.envs.base import TaskFamily
from vtlib.qfunctions import QFunction
from vtlib.rng import Rng
from vtlib.training import Agent
from vtlib.transfer import Settings

ITERATIONS = 10_000
# The labels under which a pool's solved sources and an experiment's targets are stored.
SOURCES, TASKS = "sources", "tasks"


@runtime_checkable
class Algorithm(Protocol):
    """The settings of an algorithm: a frozen attrs class, stored beside what it computes."""

    transfers: ClassVar[bool]

    def agent(self, q: QFunction, given: Tensor, obs_dim: int, rng: Rng, /) -> Agent:
        """The agent of R runs: sources (R, S, d) are given if it transfers, else weights (R, d)."""


def _check_algorithm(name: str, value: object) -> None:
    check_kind(name, value, Algorithm)
    if not attrs.has(type(value)):
        raise ValueError(f"{name} must be of an attrs class, got {shown(value)}")


@frozen
class Pool:
    """A pool of source tasks of ``family``, solved without transfer.

    A source is kept at the first check, from ``iterations`` on, at which its greedy policy passes
    twice: over ``episodes`` episodes, and over as many fresh ones, it reaches the ``required``
    share, as the family measures it. The others are trained on, up to ``limit`` iterations, and
    then begin anew, from the same weights with other random numbers, until they have had so many
    ``attempts``. ``common`` starts all
    networks from the same weights: only then do hidden units stay comparable between sources, so
    that weights can be averaged. Sources begin episodes where the family has it for sources, or,
    ``as_targets``, where targets do. Pools that share a ``stream`` share tasks and random numbers.
    Raises ValueError for a value outside its range.
    """

    name: str = field(validator=checks.name())
    family: TaskFamily = field(validator=checks.kind(TaskFamily))
    count: int = field(default=50, validator=checks.whole())
    iterations: int = field(default=20_000, validator=checks.whole())
    limit: int = field(default=150_000, validator=checks.whole())
    check_every: int = field(default=1_000, validator=checks.whole())
    episodes: int = field(default=200, validator=checks.whole())
    required: float = field(default=0.9, validator=checks.between(0, 1))
    attempts: int = field(default=1, validator=checks.whole())
    settings: Algorithm = field(default=MellowTDSettings(epsilon_steps=14_000))
    common: bool = field(default=True, validator=checks.kind(bool))
    as_targets: bool = field(default=False, validator=checks.kind(bool))
    stream: str = field(
        default=Factory(lambda self: self.name, takes_self=True), validator=checks.name()
    )

    def __attrs_post_init__(self) -> None:
        try:
            self.family.source_tasks(self.stream, [self.count - 1])
        except IndexError:
            raise ValueError(
                f"count must not exceed the tasks of the family, got {self.count}"
            ) from None
        _check_algorithm("settings", self.settings)
        if self.settings.transfers:
            raise ValueError(f"settings must not transfer, got {shown(self.settings)}")


@frozen
class Experiment:
    """A figure's runs: targets from ``family``, ``sources`` of ``pool`` drawn for each run.

    Returns are recorded ``every`` so many of ``iterations``. Runs are seeded by ``stream``:
    experiments that share it share targets, sources and random numbers run by run. Each
    ``runs_per_task`` consecutive runs have one target. ``counts`` names algorithms that use only
    the first so many of a run's sources; ``excluded`` are sources that no run may draw; ``visits``
    keeps the positions that the agents visit; ``probes`` is the number of places at which
    the posterior is looked at along the way (see ``vtlib.experiments.probes``). The greedy return
    of a mixture is that of its mean Q-function, or the mean over ``each`` of its components. Raises
    ValueError for a value outside its range.
    """

    name: str = field(validator=checks.name())
    pool: Pool = field(validator=checks.kind(Pool))
    family: TaskFamily = field(validator=checks.kind(TaskFamily))
    algorithms: Mapping[str, Algorithm] = field(validator=checks.kind(Mapping))
    runs: int = field(default=20, validator=checks.whole())
    sources: int = field(default=10, validator=checks.whole())
    iterations: int = field(default=ITERATIONS, validator=checks.whole())
    every: int = field(default=100, validator=checks.whole())
    stream: str = field(
        default=Factory(lambda self: self.name, takes_self=True), validator=checks.name()
    )
    runs_per_task: int = field(default=1, validator=checks.whole())
    counts: Mapping[str, int] = field(factory=dict, validator=checks.kind(Mapping))
    visits: bool = field(default=False, validator=checks.kind(bool))
    excluded: tuple[int, ...] = field(default=(), validator=checks.kind(tuple))
    probes: int = field(default=0, validator=checks.whole(0))
    each: bool = field(default=False, validator=checks.kind(bool))

    def __attrs_post_init__(self) -> None:
        # sources are of use only to tasks with the same Q-function
        check_kind("family", self.family, type(self.pool.family))
        if not self.algorithms:
            raise ValueError(f"algorithms must name at least one, got {shown(self.algorithms)}")
        for label, algorithm in self.algorithms.items():
            check_name("a label in algorithms", label)
            if label == TASKS:
                raise ValueError(f"algorithms must not be called {TASKS!r}, got {shown(label)}")
            _check_algorithm(f"algorithms[{label!r}]", algorithm)
        check_whole("every", self.every, 1, self.iterations)
        if self.runs % self.runs_per_task:
            raise ValueError(
                f"runs_per_task must divide the {self.runs} runs, got {self.runs_per_task}"
            )
        for index in self.excluded:
            check_whole("excluded", index, 0, self.pool.count - 1)
        check_whole("sources", self.sources, 1, len(self.eligible))
        for label, count in self.counts.items():
            check_one_of("a label in counts", label, self.algorithms)
            check_whole(f"counts[{label!r}]", count, 1, self.sources)
        if self.probes and not all(one.transfers for one in self.algorithms.values()):
            raise ValueError(f"probes must be 0 unless all algorithms transfer, got {self.probes}")

    @property
    def eligible(self) -> list[int]:
        """Indices of the pool's sources that a run may draw."""
        return [i for i in range(self.pool.count) if i not in self.excluded]

    def task_of(self, run: int) -> int:
        """Number of the target task of a run."""
        return run // self.runs_per_task

    def transfer_settings(self, label: str) -> Settings:
        """The settings of an algorithm that transfers; ValueError when it is another one."""
        settings = self.algorithms[label]
        check_kind(f"algorithms[{label!r}]", settings, Settings)
        assert isinstance(settings, Settings)
        return settings

    def sources_of(self, label: str) -> int:
        """How many of a run's sources an algorithm uses."""
        return self.counts.get(label, self.sources)


PSIS = (0.0, 0.5, 1.0)
POSTERIORS = ("GVT", "1-MGVT", "2-MGVT", "3-MGVT")


def slider_lambdas(base: Settings) -> tuple[float, ...]:
    """Five powers of ten around the lambda of the thesis' setting, which must not be 0."""
    check_positive("lambda_", base.lambda_)
    middle = round(math.log10(base.lambda_))
    return tuple(float(f"1e{middle + step}") for step in (-2, -1, 0, 1, 2))


def count_name(algorithm: str, count: int) -> str:
    """The name under which an algorithm with so many sources is stored."""
    return f"{algorithm}-from-{count}"


def slider_name(lambda_: float, psi: float, posterior: str) -> str:
    """The name under which one setting of the sliders is stored."""
    return f"{posterior}-lambda-{lambda_:.0e}-psi-{psi:g}"


def slider_settings(
    thesis: Mapping[str, Settings], lambda_: float, psi: float, posterior: str
) -> Settings:
    """One setting of the sliders around the thesis' of "GVT" and "1-MGVT"."""
    if posterior == "GVT":
        return evolve(thesis["GVT"], lambda_=lambda_, psi=psi)
    components = int(posterior.removesuffix("-MGVT"))
    return evolve(thesis["1-MGVT"], lambda_=lambda_, psi=psi, components=components)


def slider_thesis(experiment: Experiment) -> dict[str, Settings]:
    """The thesis' settings around which sliders move; ValueError when an experiment lacks one."""
    for label in ("GVT", "1-MGVT"):
        check_one_of("the sliders' algorithm", label, experiment.algorithms)
    return {label: experiment.transfer_settings(label) for label in ("GVT", "1-MGVT")}


def sliders_of(
    experiment: Experiment,
    name: str,
    runs: int,
    iterations: int,
    lambdas: Sequence[float] | None = None,
    psis: Sequence[float] = PSIS,
    posteriors: Sequence[str] = POSTERIORS,
) -> Experiment:
    """The settings of the sliders around GVT and 1-MGVT, on an experiment's first runs or tasks.

    lambdas, psis, posteriors: those of the sliders; lambdas are ``slider_lambdas`` of 1-MGVT by
    default. Raises ValueError when the experiment lacks GVT or 1-MGVT.
    """
    thesis = slider_thesis(experiment)
    lambdas = lambdas or slider_lambdas(thesis["1-MGVT"])
    return evolve(
        experiment,
        name=name,
        algorithms={
            slider_name(*setting): slider_settings(thesis, *setting)
            for setting in itertools.product(lambdas, psis, reversed(posteriors))
        },
        runs=runs,
        iterations=iterations,
        runs_per_task=1,
    )
