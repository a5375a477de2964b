"""Source tasks: solved without transfer, checked against the optimum, trained on if short."""

from collections.abc import Sequence
from itertools import islice
from typing import Any

import numpy as np
import torch

from vtlab.episodes import Episodes
from vtlab.evaluation import Evaluation
from vtlab.experiment import Pool
from vtlab.training import FINGERPRINTS, fingerprint
from vtlib.rng import Rng, Stream
from vtlib.training import arithmetic, check_finite, iterate

FRESH = 400  # episodes by which solved sources are judged in the end


class AttemptRng(Rng):
    """Random numbers of an attempt to solve sources; streams of the first, 0, bear no number."""

    def __init__(self, experiment: str, runs: Sequence[int], attempt: int) -> None:
        super().__init__(experiment, runs)
        self._attempt = attempt

    def stream(self, role: str) -> Stream:
        """The stream of a role in this attempt, from its beginning."""
        return super().stream(f"{role} {self._attempt}" if self._attempt else role)


class SourceTraining:
    """Learning of some sources of a pool, in lock-step; their first attempt is number 0."""

    def __init__(self, pool: Pool, sources: Sequence[int], attempt: int = 0) -> None:
        family, rng = pool.family, AttemptRng(pool.stream, sources, attempt)
        self.names = [f"source {i} of {pool.name}" for i in sources]
        self.tasks, q = family.source_tasks(pool.stream, sources), family.q()
        start = family.first_weights(pool.stream, [0] * len(sources) if pool.common else sources)
        # an agent that can keep some of its runs
        self.agent: Any = pool.settings.agent(q, start, self.tasks.obs_dim, rng)
        learned = self.tasks if pool.as_targets else family.for_sources(self.tasks)
        noise, starts = rng.stream("noise"), rng.stream("start")
        self.episodes = Episodes(learned, noise, starts, family.window)
        self.evaluate = Evaluation(q, self.tasks, rng, pool.episodes)
        self.steps = 0
        self.fingerprints: list[np.ndarray] = []
        self._loop = iterate(self.agent, self.episodes)

    def advance(self, iterations: int) -> None:
        """Train for some iterations; raises Diverged when weights are not finite."""
        for t in islice(self._loop, iterations):
            if t in FINGERPRINTS:
                self.fingerprints.append(fingerprint(self.agent, self.episodes))
        self.steps += iterations
        check_finite(self.agent.mu, self.names, self.steps)

    def keep(self, rows: Sequence[int]) -> None:
        """Go on with some of the sources, by their places in the batch, in that order."""
        for part in (self.agent, self.episodes, self.evaluate):
            part.keep(rows)
        self.names = [self.names[row] for row in rows]


def solve(pool: Pool, sources: Sequence[int]) -> dict[str, np.ndarray]:
    """Train and check some sources of a pool until each is solved or has had its attempts.

    Returns arrays over the sources: index, the tasks' parameters, weights (S, d), iterations
    trained in all, greedy (return of the kept weights), optimum, solved, fingerprints, fresh (their
    return on episodes that decided nothing) and passes (whether that return solves the task).
    """
    arrays = _attempt(pool, sources, 0)
    for attempt in range(1, pool.attempts):
        unsolved = np.flatnonzero(~arrays["solved"])
        if not len(unsolved):
            break
        new = _attempt(pool, [sources[i] for i in unsolved.tolist()], attempt)
        better = new["solved"] | (new["greedy"] > arrays["greedy"][unsolved])
        for key in ("weights", "iterations", "greedy", "solved"):
            arrays[key][unsolved[better]] = new[key][better]
    return {
        "index": np.array(sources),
        **pool.family.values(pool.family.source_tasks(pool.stream, sources)),
        **arrays,
        **judge(pool, sources, arrays["weights"], arrays["optimum"]),
    }


def judge(
    pool: Pool, sources: Sequence[int], weights: np.ndarray, optimum: np.ndarray
) -> dict[str, np.ndarray]:
    """What weights (S, d) of some sources earn on fresh episodes (S,), and which pass (S,)."""
    tasks = pool.family.source_tasks(pool.stream, sources)
    rng = Rng(f"{pool.stream} fresh", sources)
    evaluate = Evaluation(pool.family.q(), tasks, rng, FRESH)
    returns = evaluate.episodes(torch.from_numpy(weights).unsqueeze(1))
    passes = pool.family.solved(returns, torch.from_numpy(optimum), pool.required)
    return {"fresh": returns.mean(1).numpy(), "passes": passes.numpy()}


def _attempt(pool: Pool, sources: Sequence[int], attempt: int) -> dict[str, np.ndarray]:
    """One attempt to solve some sources: what each keeps, and its fingerprints."""
    training, before = SourceTraining(pool, sources, attempt), attempt * pool.limit
    left = torch.arange(len(sources))  # places of the sources that are still trained
    optimum = pool.family.optimum(training.tasks)
    weights = torch.zeros_like(training.agent.mu[:, 0])
    greedy = torch.full_like(optimum, -torch.inf)
    iterations = torch.zeros(len(sources), dtype=torch.int64)
    solved = torch.zeros(len(sources), dtype=torch.bool)
    training.advance(pool.iterations)
    while True:
        returns = training.evaluate.episodes(training.agent.mu)
        means = returns.mean(1)
        passes = pool.family.solved(returns, optimum[left], pool.required)
        if passes.any():  # the check that ends the training is partly luck: fresh episodes decide
            fresh = training.evaluate.episodes(training.agent.mu)
            passes &= pool.family.solved(fresh, optimum[left], pool.required)
            means = torch.where(passes, fresh.mean(1), means)
        # an unsolved source keeps the best weights that any check has seen
        better = passes | (means > greedy[left])
        weights[left[better]] = training.agent.mu.detach()[better, 0]
        greedy[left[better]] = means[better]
        iterations[left[better]] = before + training.steps
        solved[left[passes]] = True
        if solved.all() or training.steps >= pool.limit:
            break
        if passes.any():
            training.keep((~passes).nonzero().flatten().tolist())
            left = left[~passes]
        training.advance(pool.check_every)
    tensors = {"weights": weights, "iterations": iterations, "greedy": greedy, "optimum": optimum}
    arrays = {key: tensor.numpy() for key, tensor in (tensors | {"solved": solved}).items()}
    return arrays | {"fingerprints": np.stack(training.fingerprints, 1)}


@arithmetic()
def head(pool: Pool, sources: Sequence[int]) -> np.ndarray:
    """Fingerprints (S, 3, 4) of the first iterations of some sources, computed anew."""
    training = SourceTraining(pool, sources)
    training.advance(FINGERPRINTS[-1])
    return np.stack(training.fingerprints, 1)
