"""Source tasks: solved without transfer, checked against the optimum, trained on if short."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch

from vtlib.baselines import DDQN, DDQNSettings, MellowTD, MellowTDSettings
from vtlib.checks import check_between, check_kind, check_name, check_weights, check_whole
from vtlib.domains import Family, domain, first_weights, parameters
from vtlib.envs.episodes import Episodes, Tasks
from vtlib.envs.maze import MazeFamily, Mazes
from vtlib.evaluation import GreedyReturn
from vtlib.streams import Stream, generator
from vtlib.training import FINGERPRINTS, check_finite, fingerprint


@dataclass(frozen=True)
class Pool:
    """A pool of solved source tasks.

    A source is kept at the first check, from ``iterations`` on, at which its greedy policy passes:
    over ``episodes`` episodes it reaches the ``required`` share, by its domain's measure. The
    others are trained on, up to ``limit`` iterations, and then begin anew, from the same weights
    with other random numbers, until they have had so many ``attempts``. Rooms sources start their
    episodes anywhere in the square: from the corner alone, chance rarely finds the goal. Raises
    ValueError for a value outside its range.
    """

    name: str
    family: Family
    count: int = 50
    iterations: int = 20_000
    limit: int = 150_000
    check_every: int = 1_000
    episodes: int = 200
    required: float = 0.9
    attempts: int = 1
    settings: MellowTDSettings | DDQNSettings = field(
        default_factory=lambda: MellowTDSettings(epsilon_steps=14_000)
    )

    def __post_init__(self) -> None:
        check_name("name", self.name)
        check_kind("family", self.family, Family)
        for name in ("count", "iterations", "limit", "check_every", "episodes", "attempts"):
            check_whole(name, getattr(self, name))
        check_between("required", self.required, 0, 1)
        check_kind("settings", self.settings, MellowTDSettings | DDQNSettings)

    @property
    def stream(self) -> str:
        """What seeds the sources."""
        return self.name

    def for_learning(self, tasks: Tasks) -> Tasks:
        """The tasks as the sources learn them."""
        return domain(self.family).for_sources(tasks)


@dataclass(frozen=True)
class NetworkPool(Pool):
    """A pool of networks; ``common`` starts them all from the same weights.

    Only then do hidden units stay comparable between sources, so that weights can be averaged.
    A pool has the tasks and the random numbers of its ``twin``, if it names one. Raises ValueError
    for a value outside its range.
    """

    common: bool = True
    twin: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_kind("common", self.common, bool)
        if self.twin != "":
            check_name("twin", self.twin)

    @property
    def stream(self) -> str:
        """What seeds the sources."""
        return self.twin or self.name


@dataclass(frozen=True)
class MazePool(NetworkPool):
    """A pool of networks with one source for each maze that the family names, in their order.

    Raises ValueError for a value outside its range, such as another count.
    """

    family: MazeFamily

    def __post_init__(self) -> None:
        super().__post_init__()
        check_kind("family", self.family, MazeFamily)
        mazes = len(self.family.names)
        check_whole("count", self.count, mazes, mazes)


def pool_tasks(pool: Pool, sources: Sequence[int]) -> Tasks:
    """The tasks of some sources of a pool, each drawn from a generator of its own, or named."""
    if isinstance(pool, MazePool):
        return Mazes.of([pool.family.names[i] for i in sources])
    return draw_tasks(pool.family, pool.stream, sources)


def check_pool_weights(pool: Pool, weights: object) -> None:
    """Raise ValueError unless weights are an array (count, d) of one finite vector per source."""
    check_kind(f"weights of {pool.name}", weights, np.ndarray)
    check_weights(f"weights of {pool.name}", weights, pool.count, domain(pool.family).q().d)


def draw_tasks(family: Family, experiment: str, runs: Sequence[int]) -> Tasks:
    """One task for each run, whatever the other runs are."""
    # Any: the family's own kind of tasks
    drawn: list[Any] = [family.sample(generator(experiment, run, "task"), 1) for run in runs]
    return family.join(drawn)


class SourceTraining:
    """Learning of some sources of a pool, in lock-step; their first attempt is number 0."""

    def __init__(self, pool: Pool, sources: Sequence[int], attempt: int = 0) -> None:
        def stream(role: str) -> Stream:
            return Stream(pool.stream, sources, f"{role} {attempt}" if attempt else role)

        self.names = [f"source {i} of {pool.name}" for i in sources]
        self.tasks = pool_tasks(pool, sources)
        mine = domain(pool.family)
        q = mine.q()
        common = isinstance(pool, NetworkPool) and pool.common
        start = first_weights(pool.family, pool.stream, [0] * len(sources) if common else sources)
        learner = DDQN if isinstance(pool.settings, DDQNSettings) else MellowTD
        streams = stream("exploration"), stream("replay")
        self.agent = learner(q, start, self.tasks.obs_dim, pool.settings, *streams)
        learning = pool.for_learning(self.tasks)
        self.episodes = Episodes(learning, stream("noise"), stream("start"), mine.window)
        self.greedy_return = GreedyReturn(
            q, self.tasks, stream("test noise"), stream("test start"), pool.episodes
        )
        self.steps = 0
        self.fingerprints: list[np.ndarray] = []

    def advance(self, iterations: int) -> None:
        """Train for some iterations; raises Diverged when weights are not finite."""
        for _ in range(iterations):
            self.agent.learn(self.episodes.step(self.agent.act(self.episodes.obs, None)))
            self.steps += 1
            if self.steps in FINGERPRINTS:
                self.fingerprints.append(fingerprint(self.agent, self.episodes))
        check_finite(self.agent.mu, self.names, self.steps)

    def keep(self, rows: Sequence[int]) -> None:
        """Go on with some of the sources, by their places in the batch, in that order."""
        for part in (self.agent, self.episodes, self.greedy_return):
            part.keep(rows)
        self.names = [self.names[row] for row in rows]


def solve(
    pool: Pool, sources: Sequence[int], progress: Callable[[int], object] = lambda done: None
) -> dict[str, np.ndarray]:
    """Train and check some sources of a pool until each is solved or has had its attempts.

    Returns arrays over the sources: index, the tasks' parameters, weights (S, d), iterations
    trained in all, greedy (return of the kept weights), optimum, solved and fingerprints.
    """
    found = _attempt(pool, sources, 0, progress)
    for attempt in range(1, pool.attempts):
        left = np.flatnonzero(~found["solved"]).tolist()
        if not left:
            break
        again = _attempt(pool, [sources[i] for i in left], attempt, progress)
        better = again["solved"] | (again["greedy"] > found["greedy"][left])
        for key in ("weights", "iterations", "greedy", "solved"):
            found[key][np.array(left)[better]] = again[key][better]
    return {
        "index": np.array(sources),
        **parameters(pool.family, pool_tasks(pool, sources)),
        **found,
    }


def _attempt(
    pool: Pool, sources: Sequence[int], attempt: int, progress: Callable[[int], object]
) -> dict[str, np.ndarray]:
    """One attempt to solve some sources: what each keeps, and its fingerprints."""
    training = SourceTraining(pool, sources, attempt)
    mine, before = domain(pool.family), attempt * pool.limit
    left = torch.arange(len(sources))  # those still trained, by their places among the sources
    optimum = mine.optimum(training.tasks)
    weights = torch.zeros_like(training.agent.mu[:, 0])
    greedy = torch.full_like(optimum, -torch.inf)
    trained = torch.zeros(len(sources), dtype=torch.int64)
    solved = torch.zeros(len(sources), dtype=torch.bool)
    while training.steps < pool.iterations:
        training.advance(min(pool.check_every, pool.iterations - training.steps))
        progress(before + training.steps)
    while True:
        returns = training.greedy_return.episodes(training.agent.mu)
        earned = returns.mean(1)
        passed = mine.passes(returns, optimum[left], pool.required)
        # an unsolved source keeps the best weights that any check has seen
        better = passed | (earned > greedy[left])
        weights[left[better]] = training.agent.mu.detach()[better, 0]
        greedy[left[better]] = earned[better]
        trained[left[better]] = before + training.steps
        solved[left[passed]] = True
        if solved.all() or training.steps >= pool.limit:
            break
        if passed.any():
            training.keep((~passed).nonzero().flatten().tolist())
            left = left[~passed]
        training.advance(pool.check_every)
        progress(before + training.steps)
    return {
        "weights": weights.numpy(),
        "iterations": trained.numpy(),
        "greedy": greedy.numpy(),
        "optimum": optimum.numpy(),
        "solved": solved.numpy(),
        "fingerprints": np.stack(training.fingerprints, 1),
    }


def head(pool: Pool, sources: Sequence[int]) -> np.ndarray:
    """Fingerprints (S, 3, 4) of the first iterations of some sources, computed anew."""
    training = SourceTraining(pool, sources)
    training.advance(FINGERPRINTS[-1])
    return np.stack(training.fingerprints, 1)
