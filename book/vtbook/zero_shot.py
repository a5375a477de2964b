"""What sources earn in a new task before anything is learned there."""

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from vtbook.credible_intervals import posterior_samples
from vtlab.evaluation import Evaluation
from vtlab.experiment import Experiment
from vtlab.run import chosen_sources, prepare, targets
from vtlib.rng import Rng
from vtlib.transfer import VariationalTransfer


def zero_shot(
    experiment: Experiment, weights: np.ndarray, episodes: int = 200, of_mean: bool = False
) -> np.ndarray:
    """What each run's sources earn without learning (R,), by the best of them at each step.

    weights (count, d) are those of the pool's sources; or by the mean of a run's own. The best is
    the source of the largest value. That is no generalised policy improvement (Barreto et al.,
    2017), which needs the values of the sources' policies in the target.
    """
    sources = torch.from_numpy(weights[chosen_sources(experiment, range(experiment.runs))])
    if of_mean:
        sources = sources.mean(1, keepdim=True)
    stream = f"{experiment.stream} zero-shot"
    return greedy_returns(experiment, sources, stream, episodes, over="max")


def greedy_returns(
    experiment: Experiment, weights: Tensor, stream: str, episodes: int = 20, over: str = "each"
) -> np.ndarray:
    """What the greedy policies of weights (R, C, d) earn in each run's task, (R,).

    over: as for ``Evaluation``, by default the mean of the C policies.
    """
    runs = range(experiment.runs)
    noise, tasks = Rng(stream, runs), targets(experiment, runs)
    return Evaluation(experiment.family.q(), tasks, noise, episodes, over)(weights).numpy()


def at_start(
    experiment: Experiment, label: str, weights: np.ndarray, stream: str, samples: int = 10
) -> Mapping[str, np.ndarray]:
    """The same of a posterior's mean and of its samples (R,), before the first step."""
    runs, d = range(experiment.runs), experiment.family.q().d
    agent = prepare(experiment, label, runs, weights).agent
    assert isinstance(agent, VariationalTransfer)
    noise = Rng(f"{stream} samples", runs).stream(label).normal(samples * d)
    mu = agent.mu.detach()
    sample = posterior_samples(mu, agent.scale_tril, noise.view(len(runs), 1, samples, d))
    return {
        "mean": greedy_returns(experiment, mu, stream),
        "sample": greedy_returns(experiment, sample, stream),
    }
