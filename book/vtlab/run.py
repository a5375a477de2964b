"""One batch of runs of an experiment: draw targets and sources, build the agents, train."""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from attrs import evolve, frozen
from torch import Tensor

from vtlab.envs.base import TaskBatch
from vtlab.episodes import Episodes
from vtlab.evaluation import Evaluation
from vtlab.experiment import Experiment
from vtlab.native.runs import NativeRun, supports, train_natively
from vtlab.training import FINGERPRINTS, train
from vtlib.rng import Rng, generator
from vtlib.training import Agent, arithmetic

EVALUATION_EPISODES = 10


@frozen
class Batch:
    """Some runs of one algorithm, ready to train."""

    agent: Agent
    episodes: Episodes
    evaluate: Callable[[Tensor], Tensor | None]


def targets(experiment: Experiment, runs: Sequence[int]) -> TaskBatch:
    """The target task of each run."""
    return experiment.family.draw_tasks(
        experiment.stream, [run // experiment.runs_per_task for run in runs]
    )


def chosen_sources(experiment: Experiment, runs: Sequence[int]) -> np.ndarray:
    """Indices (R, sources) of the pool's sources that each run transfers from."""
    rngs = [generator(experiment.stream, run, "sources") for run in runs]
    eligible, count = experiment.eligible, experiment.sources
    return np.stack([rng.choice(eligible, count, replace=False) for rng in rngs])


def prepare(experiment: Experiment, label: str, runs: Sequence[int], weights: np.ndarray) -> Batch:
    """Agents, episodes and evaluation of some runs of an algorithm, from weights (count, d)."""
    family, rng = experiment.family, Rng(experiment.stream, runs)
    tasks, start = targets(experiment, runs), _start(experiment, label, runs, weights)
    noise, starts = rng.stream("noise"), rng.stream("start")
    return Batch(
        experiment.algorithms[label].agent(family.q(), start, tasks.obs_dim, rng),
        Episodes(tasks, noise, starts, family.window, experiment.visits),
        _evaluation(experiment, runs),
    )


def _evaluation(experiment: Experiment, runs: Sequence[int]) -> Callable[[Tensor], Tensor | None]:
    """What tells the greedy returns (R,) of weights, or None where they are not recorded."""
    if not experiment.greedy:
        return lambda mu: None
    q, rng = experiment.family.q(), Rng(experiment.stream, runs)
    over = "each" if experiment.each else "mean"
    return Evaluation(q, targets(experiment, runs), rng, EVALUATION_EPISODES, over)


def _start(experiment: Experiment, label: str, runs: Sequence[int], weights: np.ndarray) -> Tensor:
    """What an algorithm begins with: the sources (R, S, d) of each run, or first weights (R, d)."""
    if not experiment.algorithms[label].transfers:
        return experiment.family.first_weights(experiment.stream, runs)
    sources = chosen_sources(experiment, runs)[:, : experiment.sources_of(label)]
    return torch.from_numpy(weights[sources])


@arithmetic()
def run_batch(
    experiment: Experiment,
    label: str,
    runs: Sequence[int],
    weights: np.ndarray,
    progress: Callable[[int], bool] | None = None,
    threads: int = 1,
) -> dict[str, np.ndarray]:
    """Train some runs of an algorithm: arrays to store.

    They are run (R,), iterations (T,) of the records, learning and greedy returns (R, T),
    fingerprints (R, 3, 4), and whatever the experiment's visits and probes add, over the runs.
    weights are as for ``prepare``; progress gets the iteration at each record, and stops the
    training by returning False. The kernels advance as many runs at once as there are threads.
    """
    names = [f"run {run} of {experiment.name}, {label}" for run in runs]
    arguments = experiment.iterations, experiment.every, names, progress
    native = prepare_natively(experiment, label, runs, weights)
    if native is not None:
        records = train_natively(native, _evaluation(experiment, runs), *arguments, threads)
    else:
        batch, probe = prepare(experiment, label, runs, weights), None
        if experiment.probe is not None:
            probe = experiment.probe(experiment, label, runs, targets(experiment, runs))

        def evaluate(mu: Tensor) -> Tensor | None:
            if probe is not None:
                probe.look(batch.agent)
            return batch.evaluate(mu)

        records = train(batch.agent, batch.episodes, evaluate, *arguments)
        if experiment.visits:
            records["visited"] = batch.episodes.visited.numpy()
        if probe is not None:
            records |= probe.arrays
    return {"run": np.array(runs), **records}


def prepare_natively(
    experiment: Experiment, label: str, runs: Sequence[int], weights: np.ndarray
) -> list[NativeRun] | None:
    """Some runs of an algorithm in C++; None where the kernels cannot run it."""
    if not by_kernels(experiment, label):
        return None
    family, algorithm, stream = experiment.family, experiment.algorithms[label], experiment.stream
    tasks, start = targets(experiment, runs), _start(experiment, label, runs, weights)
    return [
        NativeRun(family, tasks, row, algorithm, start[row], stream, run)
        for row, run in enumerate(runs)
    ]


def by_kernels(experiment: Experiment, label: str) -> bool:
    """Whether the stored result of a label is the kernels', which compute each run alone."""
    if label not in experiment.algorithms or experiment.visits or experiment.probe:
        return False  # the kernels record nothing but returns
    algorithm, sources = experiment.algorithms[label], experiment.sources_of(label)
    return supports(experiment.family, algorithm, sources)


def head(
    experiment: Experiment, label: str, runs: Sequence[int], weights: np.ndarray
) -> np.ndarray:
    """Fingerprints (R, 3, 4) of the first iterations of some runs, computed anew."""
    last = min(FINGERPRINTS[-1], experiment.iterations)
    short = evolve(experiment, iterations=last, every=last, visits=False, probes=0, probe=None)
    return run_batch(short, label, runs, weights)["fingerprints"]


def task_table(experiment: Experiment) -> dict[str, np.ndarray]:
    """Targets, chosen sources and planned optimum of all runs."""
    runs = range(experiment.runs)
    firsts = targets(experiment, runs[:: experiment.runs_per_task])
    return {
        **experiment.family.values(targets(experiment, runs)),
        "sources": chosen_sources(experiment, runs),
        "optimum": experiment.family.optimum(firsts).numpy().repeat(experiment.runs_per_task),
    }
