"""What sources earn in a new task before anything is learned there."""

import numpy as np
import torch

from vtlab.evaluation import Evaluation
from vtlab.experiment import Experiment
from vtlab.run import chosen_sources, targets
from vtlab.sources import check_pool_weights
from vtlib.rng import Rng


def zero_shot(
    experiment: Experiment, weights: np.ndarray, episodes: int = 200, of_mean: bool = False
) -> np.ndarray:
    """What each run's sources earn without learning (R,), by the best of them at each step.

    weights (count, d) are those of the pool's sources; or by the mean of a run's own. Source:
    Barreto et al. (2017), generalised policy improvement.
    """
    runs, family = range(experiment.runs), experiment.family
    check_pool_weights(experiment.pool, weights)
    rng = Rng(f"{experiment.stream} zero-shot", runs)
    evaluate = Evaluation(family.q(), targets(experiment, runs), rng, episodes, "max")
    given = torch.from_numpy(weights[chosen_sources(experiment, runs)])
    return evaluate(given.mean(1, keepdim=True) if of_mean else given).numpy()
