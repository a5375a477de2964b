"""What an experiment is: frozen configurations of source pools and of runs."""

from collections.abc import Callable, Mapping
from typing import Any, Protocol, runtime_checkable

import attrs
from attrs import Factory, field, frozen
from torch import Tensor

from vtlab.envs.base import TaskFamily
from vtlab.training import FINGERPRINTS
from vtlib import checks
from vtlib.baselines import MellowTDSettings
from vtlib.checks import check_kind, check_one_of, check_whole, shown
from vtlib.qfunctions import QFunction
from vtlib.rng import Rng
from vtlib.training import Agent

ITERATIONS = 10_000
# The labels under which a pool's solved sources and an experiment's targets are stored.
SOURCES, TASKS = "sources", "tasks"


def check_name(name: str, value: object) -> None:
    """Raise ValueError unless value can name something in texts and be the name of a file."""
    text = value if isinstance(value, str) else ""
    if not (text.strip(" .") and text.isprintable() and "/" not in text):
        allowed = "a text on one line, not empty, without '/'"
        raise ValueError(f"{name} must be {allowed}, got {shown(value)}")


def _named(_: Any, field: Any, value: Any) -> None:
    check_name(field.name, value)


@runtime_checkable
class Algorithm(Protocol):
    """The settings of an algorithm: a frozen attrs class, stored beside what it computes."""

    @property
    def transfers(self) -> bool: ...

    def agent(self, q: QFunction, start: Tensor, obs_dim: int, rng: Rng, /) -> Agent:
        """The agent of R runs: start is sources (R, S, d) if it transfers, else weights (R, d)."""


def _check_algorithm(name: str, value: object) -> None:
    check_kind(name, value, Algorithm)
    if not attrs.has(type(value)):
        raise ValueError(f"{name} must be of an attrs class, got {shown(value)}")


@frozen
class Pool:
    """A pool of source tasks of ``family``, solved without transfer.

    A source is kept at the first check, from ``iterations`` on, at which its greedy policy reaches
    the ``required`` share twice, over ``episodes`` episodes and over as many fresh ones. Other
    sources are trained on, up to ``limit`` iterations, and then begin anew from the same weights,
    until they have had so many ``attempts``. ``common`` starts all networks from the same weights:
    only then do hidden units stay comparable, so that weights can be averaged. ``as_targets``
    begins episodes where targets do, not where the family has sources begin. Pools that share a
    ``stream`` share tasks and random numbers. Raises ValueError for a value outside its range.
    """

    name: str = field(validator=_named)
    family: TaskFamily = field(validator=checks.kind(TaskFamily))
    count: int = field(default=50, validator=checks.whole())
    iterations: int = field(default=20_000, validator=checks.whole(FINGERPRINTS[-1]))
    limit: int = field(default=150_000, validator=checks.whole())
    check_every: int = field(default=1_000, validator=checks.whole())
    episodes: int = field(default=200, validator=checks.whole())
    required: float = field(default=0.9, validator=checks.between(0, 1))
    attempts: int = field(default=1, validator=checks.whole())
    settings: Algorithm = field(default=MellowTDSettings(epsilon_steps=14_000))
    common: bool = field(default=True, validator=checks.kind(bool))
    as_targets: bool = field(default=False, validator=checks.kind(bool))
    stream: str = field(default=Factory(lambda self: self.name, takes_self=True), validator=_named)

    def __attrs_post_init__(self) -> None:
        try:
            self.family.source_tasks(self.stream, [self.count - 1])
        except IndexError:
            raise ValueError(f"count must not exceed a family's tasks, got {self.count}") from None
        _check_algorithm("settings", self.settings)
        if self.settings.transfers:
            raise ValueError(f"settings must not transfer, got {shown(self.settings)}")


@frozen
class Experiment:
    """A figure's runs: targets from ``family``, ``sources`` of ``pool`` drawn for each run.

    Returns are recorded ``every`` so many of ``iterations``. Experiments that share a ``stream``
    share targets, sources and random numbers run by run. Each ``runs_per_task`` consecutive runs
    have one target. ``counts`` names algorithms that use only the first so many of a run's sources;
    ``excluded`` are sources that no run may draw; ``visits`` keeps the positions that the agents
    visit; ``probe`` makes, of an experiment, a label, some runs and their tasks, what looks at the
    agents at each record, by ``look(agent)``, in so many places as ``probes`` says; its ``arrays``
    over the runs are stored with the returns. A mixture's greedy return is earned by its mean
    Q-function, or is the mean over ``each`` of its components; without ``greedy`` none is recorded.
    Raises ValueError for a value outside its range.
    """

    name: str = field(validator=_named)
    pool: Pool = field(validator=checks.kind(Pool))
    family: TaskFamily = field(validator=checks.kind(TaskFamily))
    algorithms: Mapping[str, Algorithm] = field(validator=checks.kind(Mapping))
    runs: int = field(default=20, validator=checks.whole())
    sources: int = field(default=10, validator=checks.whole())
    iterations: int = field(default=ITERATIONS, validator=checks.whole())
    every: int = field(default=100, validator=checks.whole())
    stream: str = field(default=Factory(lambda self: self.name, takes_self=True), validator=_named)
    runs_per_task: int = field(default=1, validator=checks.whole())
    counts: Mapping[str, int] = field(factory=dict, validator=checks.kind(Mapping))
    visits: bool = field(default=False, validator=checks.kind(bool))
    excluded: tuple[int, ...] = field(default=(), validator=checks.kind(tuple))
    probes: int = field(default=0, validator=checks.whole(0))
    probe: Callable[..., Any] | None = None
    each: bool = field(default=False, validator=checks.kind(bool))
    greedy: bool = field(default=True, validator=checks.kind(bool))

    def __attrs_post_init__(self) -> None:
        # sources can serve only tasks with the same Q-function
        check_kind("family", self.family, type(self.pool.family))
        if not self.algorithms:
            raise ValueError(f"algorithms must name at least one, got {shown(self.algorithms)}")
        for label, algorithm in self.algorithms.items():
            check_name("a label in algorithms", label)
            if label in (TASKS, SOURCES):
                raise ValueError(f"algorithms must not be called like that, got {shown(label)}")
            _check_algorithm(f"algorithms[{label!r}]", algorithm)
        check_whole("every", self.every, 1, self.iterations)
        if self.runs % self.runs_per_task:
            rule = f"runs_per_task must divide the {self.runs} runs"
            raise ValueError(f"{rule}, got {self.runs_per_task}")
        for index in self.excluded:
            check_whole("excluded", index, 0, self.pool.count - 1)
        check_whole("sources", self.sources, 1, len(self.eligible))
        for label, count in self.counts.items():
            check_one_of("a label in counts", label, self.algorithms)
            check_whole(f"counts[{label!r}]", count, 1, self.sources)
        if bool(self.probes) != (self.probe is not None):
            raise ValueError(f"probes must be 0 without a probe, else more, got {self.probes}")

    @property
    def eligible(self) -> list[int]:
        """Indices of the pool's sources that a run may draw."""
        return [i for i in range(self.pool.count) if i not in self.excluded]

    def sources_of(self, label: str) -> int:
        """How many of a run's sources an algorithm uses."""
        return self.counts.get(label, self.sources)
