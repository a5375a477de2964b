"""Walks: the states that episodes of a policy go through, for pictures of where it leads."""

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from vtlab.envs.base import TaskBatch


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
