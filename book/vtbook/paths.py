"""Walks: the states that episodes of a policy go through, for pictures of where it leads."""

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from vtlab.envs.base import TaskBatch
from vtlab.experiment import Experiment
from vtlab.run import chosen_sources, targets
from vtlab.store import weights
from vtlib.qfunctions import greedy
from vtlib.rng import Rng


def walks(
    tasks: TaskBatch, policy: Callable[[Tensor], Tensor], start: Tensor, noise: Tensor
) -> list[np.ndarray]:
    """The states (T, n) of one episode in each of R tasks, the first and the last included.

    The policy gives actions (R,) at states (R, n); episodes begin at start (R, n) and last at most
    as many steps as there is standard normal noise, (steps, R, noise_dim).
    """
    state, states = start, [start]
    over, length = torch.zeros(len(start), dtype=torch.bool), torch.ones(len(start)).long()
    for draw in noise:
        state, _, terminated = tasks.step(state, policy(state), draw)
        states.append(state)
        length += ~over
        over |= terminated
        if over.all():
            break
    whole = torch.stack(states, 1).numpy()
    return [walk[:last] for walk, last in zip(whole, length.tolist(), strict=True)]


def walks_of_the_mean(experiment: Experiment, steps: int) -> list[np.ndarray]:
    """The first episode in each run's task of an agent that acts by its sources' mean alone.

    It begins in the corner and acts greedily, for at most so many steps.
    """
    runs, q = range(experiment.runs), experiment.family.q()
    tasks, chosen = targets(experiment, runs), chosen_sources(experiment, runs)
    mean = torch.from_numpy(weights(experiment.pool)[chosen]).mean(1, keepdim=True)
    noise = Rng(f"{experiment.name} walks of the mean", runs).stream("noise").normal(steps * 2)
    noise = noise.view(len(runs), steps, 2).transpose(0, 1)
    start = tasks.start(torch.zeros(len(runs), 2))
    return walks(tasks, lambda state: greedy(q, mean, state), start, noise)
