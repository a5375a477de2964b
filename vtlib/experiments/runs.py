"""One batch of runs of an experiment: draw targets and sources, build the agents, train."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from vtlib.baselines import DDQN, DDQNSettings, MellowTD, MellowTDSettings
from vtlib.domains import domain, first_weights, parameters
from vtlib.envs.episodes import Episodes, RecordedEpisodes, Tasks
from vtlib.evaluation import GreedyReturn
from vtlib.experiments.deviations import DeviatingSettings, DeviatingTransfer
from vtlib.experiments.experiment import Algorithm, Experiment
from vtlib.experiments.probes import probe_of
from vtlib.sources import check_pool_weights, draw_tasks
from vtlib.streams import Stream, generator
from vtlib.training import FINGERPRINTS, Agent, train
from vtlib.transfer import Settings, VariationalTransfer

EVALUATION_EPISODES = 10


@dataclass
class Batch:
    """Some runs of one algorithm, ready to train."""

    agent: Agent
    episodes: Episodes
    greedy_return: GreedyReturn
    names: list[str]

    def advance(self) -> None:
        """One iteration of every run."""
        action = self.agent.act(self.episodes.obs, self.episodes.fresh)
        self.agent.learn(self.episodes.step(action))

    def moments(self, at: Sequence[int]) -> Iterator[int]:
        """Each of some iterations, once the runs have come to it; 0 is before the first."""
        for t in range(max(at) + 1):
            if t > 0:
                self.advance()
            if t in at:
                yield t


def targets(experiment: Experiment, runs: Sequence[int]) -> Tasks:
    """The target task of each run."""
    numbers = [experiment.task_of(run) for run in runs]
    return draw_tasks(experiment.family, experiment.stream, numbers)


def chosen_sources(experiment: Experiment, runs: Sequence[int]) -> np.ndarray:
    """Indices (R, sources) of the pool's sources that each run transfers from."""
    return np.stack(
        [
            generator(experiment.stream, run, "sources").choice(
                experiment.eligible, experiment.sources, replace=False
            )
            for run in runs
        ]
    )


def prepare(
    experiment: Experiment,
    label: str,
    algorithm: Algorithm,
    runs: Sequence[int],
    pool: np.ndarray,
    device: str = "cpu",
) -> Batch:
    """Agents, episodes and evaluation of some runs; pool (count, d) are the source weights.

    label names the algorithm in errors. Posteriors live on the device. Raises ValueError when an
    algorithm that transfers is given weights that are not finite, not float32 or of another shape.
    """
    q, tasks = domain(experiment.family).q(), targets(experiment, runs)

    def stream(role: str) -> Stream:
        return Stream(experiment.stream, runs, role)

    agent: Agent
    if isinstance(algorithm, MellowTDSettings | DDQNSettings):
        learner = DDQN if isinstance(algorithm, DDQNSettings) else MellowTD
        start = first_weights(experiment.family, experiment.stream, runs)
        streams = stream("exploration"), stream("replay")
        agent = learner(q, start, tasks.obs_dim, algorithm, *streams)
    else:
        check_pool_weights(experiment.pool, pool)
        chosen = chosen_sources(experiment, runs)[:, : experiment.sources_of(label)]
        sources = torch.from_numpy(pool[chosen]).to(device)
        three = stream("posterior"), stream("component"), stream("replay")
        if isinstance(algorithm, DeviatingSettings):
            agent = DeviatingTransfer(q, sources, tasks.obs_dim, algorithm, *three)
        else:
            agent = VariationalTransfer(q, sources, tasks.obs_dim, algorithm, *three)
    kind = RecordedEpisodes if experiment.visits else Episodes
    return Batch(
        agent,
        kind(tasks, stream("noise"), stream("start"), domain(experiment.family).window),
        GreedyReturn(q, tasks, stream("test noise"), stream("test start"), EVALUATION_EPISODES),
        [f"run {run} of {experiment.name}, {label}" for run in runs],
    )


def run_batch(
    experiment: Experiment,
    label: str,
    runs: Sequence[int],
    pool: np.ndarray,
    progress: Callable[[int], bool] | None = None,
    device: str = "cpu",
) -> dict[str, np.ndarray]:
    """Train some runs of the algorithm of that label to the experiment's end: arrays to store."""
    algorithm = experiment.algorithms[label]
    batch = prepare(experiment, label, algorithm, runs, pool, device)
    probe = None
    if experiment.probes:
        assert isinstance(algorithm, Settings)  # as the experiment has checked
        probe = probe_of(experiment, runs, targets(experiment, runs), algorithm)

    def evaluate(mu: Tensor) -> Tensor:
        if probe is not None:
            probe.look(batch.agent)
        return batch.greedy_return(mu)

    curves = train(
        batch.agent,
        batch.episodes,
        evaluate,
        experiment.iterations,
        experiment.every,
        batch.names,
        progress,
    )
    arrays = {
        "run": np.array(runs),
        "iterations": curves.iterations,
        "learning": curves.learning.astype(np.float32),
        "greedy": curves.greedy.astype(np.float32),
        "fingerprints": curves.fingerprints,
    }
    if isinstance(batch.episodes, RecordedEpisodes):
        arrays["visited"] = batch.episodes.visited.numpy()
    if probe is not None:
        arrays |= probe.arrays
    return arrays


def head(experiment: Experiment, label: str, runs: Sequence[int], pool: np.ndarray) -> np.ndarray:
    """Fingerprints (R, 3, 4) of the first iterations of some runs, computed anew."""
    batch = prepare(experiment, label, experiment.algorithms[label], runs, pool)
    last = FINGERPRINTS[-1]
    curves = train(batch.agent, batch.episodes, batch.greedy_return, last, last + 1, batch.names)
    return curves.fingerprints


def task_table(experiment: Experiment) -> dict[str, np.ndarray]:
    """Targets, chosen sources and planned optimum of all runs."""
    runs = range(experiment.runs)
    firsts = targets(experiment, runs[:: experiment.runs_per_task])
    optimum = domain(experiment.family).optimum(firsts).numpy()
    return {
        **parameters(experiment.family, targets(experiment, runs)),
        "sources": chosen_sources(experiment, runs),
        "optimum": optimum.repeat(experiment.runs_per_task),
    }
