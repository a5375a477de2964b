"""Source tasks: solved by mellow TD, checked against the planned optimum, trained on if short."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch

from vtlib.baselines import MellowTD, MellowTDSettings
from vtlib.envs.episodes import Episodes
from vtlib.envs.rooms import Rooms, RoomsFamily
from vtlib.evaluation import GreedyReturn
from vtlib.planning import optimal_return
from vtlib.qfunctions import RBFLinear
from vtlib.streams import Stream, generator
from vtlib.training import FINGERPRINTS, check_finite, fingerprint


@dataclass(frozen=True)
class Pool:
    """A pool of solved source tasks of the rooms problem (appendix A.1).

    Source episodes start anywhere in the square: from the corner alone, chance rarely finds the
    goal. A source is kept at the first check, from ``iterations`` on, at which its greedy policy
    earns ``required`` of the planned optimum from the corner, over ``episodes`` episodes; the
    others are trained on, up to ``limit`` iterations.
    """

    name: str
    family: RoomsFamily
    count: int = 50
    iterations: int = 20_000
    limit: int = 150_000
    check_every: int = 1_000
    episodes: int = 200
    required: float = 0.9
    settings: MellowTDSettings = field(
        default_factory=lambda: MellowTDSettings(epsilon_steps=14_000)
    )


def rooms_q() -> RBFLinear:
    """The rooms' Q-function: 121 normalised radial bases for each of 4 actions, 484 weights."""
    return RBFLinear(torch.arange(11.0), 1 / 9, Rooms.n_actions)


def pool_tasks(pool: Pool, sources: Sequence[int]) -> Rooms:
    """The tasks of some sources of a pool, each drawn from a generator of its own."""
    return draw_tasks(pool.family, pool.name, sources)


def draw_tasks(family: RoomsFamily, experiment: str, runs: Sequence[int]) -> Rooms:
    """One task for each run, whatever the other runs are."""
    drawn = [family.sample(generator(experiment, run, "task"), 1) for run in runs]
    return replace(drawn[0], doors=torch.cat([task.doors for task in drawn]))


class SourceTraining:
    """Mellow TD on some sources of a pool, from zero weights and uniform starts."""

    def __init__(self, pool: Pool, sources: Sequence[int]) -> None:
        def stream(role: str) -> Stream:
            return Stream(pool.name, sources, role)

        self.names = [f"source {i} of {pool.name}" for i in sources]
        self.tasks = pool_tasks(pool, sources)
        q = rooms_q()
        self.agent = MellowTD(
            q,
            torch.zeros(len(sources), q.d),
            Rooms.obs_dim,
            pool.settings,
            stream("exploration"),
            stream("replay"),
        )
        learning = replace(self.tasks, uniform_start=True)
        self.episodes = Episodes(learning, stream("noise"), stream("start"))
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


def solve(
    pool: Pool, sources: Sequence[int], progress: Callable[[int], None] = lambda done: None
) -> dict[str, np.ndarray]:
    """Train and check some sources of a pool until each is solved or the limit is reached.

    Returns arrays over the sources: index, doors, weights (S, d), iterations trained, greedy
    (return of the kept weights), optimum, solved and fingerprints.
    """
    training = SourceTraining(pool, sources)
    optimum = optimal_return(training.tasks)
    weights = torch.zeros_like(training.agent.mu[:, 0])
    greedy = torch.full_like(optimum, -1.0)
    trained = torch.zeros(len(sources), dtype=torch.int64)
    solved = torch.zeros(len(sources), dtype=torch.bool)
    training.advance(pool.iterations)
    while True:
        earned = training.greedy_return(training.agent.mu)
        # an unsolved source keeps the best weights that any check has seen
        better = ~solved & (earned > greedy)
        weights[better] = training.agent.mu.detach()[better, 0]
        greedy[better] = earned[better]
        trained[better] = training.steps
        solved |= greedy >= pool.required * optimum
        progress(training.steps)
        if solved.all() or training.steps >= pool.limit:
            break
        training.advance(pool.check_every)
    return {
        "index": np.array(sources),
        "doors": training.tasks.doors.numpy(),
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
