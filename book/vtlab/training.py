"""Runs of an experiment trained together, with what is recorded of them along the way."""

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor

from vtlab.episodes import Episodes
from vtlib.training import Agent, check_finite, iterate

FINGERPRINTS = (1, 49, 199)  # iterations within an episode: at its end all runs look alike


def train(
    agent: Agent,
    episodes: Episodes,
    evaluate: Callable[[Tensor], Tensor | None],
    iterations: int,
    every: int,
    names: list[str],
    progress: Callable[[int], bool] | None = None,
) -> dict[str, np.ndarray]:
    """Run the loop for a number of iterations, evaluating every so many of them.

    names (R,) are used in errors. evaluate gives the greedy returns (R,), or None for none.
    progress is told the iteration at each evaluation and stops the loop by returning False. Gives
    what ``recorded`` gives. Raises Diverged when weights are not finite.
    """
    times, learning, greedy, prints = [], [], [], []
    for t in itertools.islice(iterate(agent, episodes), iterations):
        if t in FINGERPRINTS:
            prints.append(fingerprint(agent, episodes))
        if t % every == 0:
            check_finite(agent.mu, names, t)
            times.append(t)
            learning.append(episodes.returns.mean().numpy())
            greedy.append(evaluate(agent.mu))
            if progress is not None and not progress(t):
                break
    return recorded(len(names), times, learning, greedy, prints)


def recorded(
    runs: int, times: Any, learning: Any, greedy: Any, prints: Any
) -> dict[str, np.ndarray]:
    """What was recorded at T times: iterations (T,), returns (R, T), fingerprints (R, 3, 4)."""
    kinds = {"learning": learning}
    if not any(x is None for x in greedy):
        kinds["greedy"] = [x.numpy() for x in greedy]
    return {
        "iterations": np.array(times),
        **{kind: np.array(x, np.float32).reshape(-1, runs).T for kind, x in kinds.items()},
        "fingerprints": np.array(prints).reshape(-1, runs, 4).swapaxes(0, 1),
    }


def fingerprint(agent: Agent, episodes: Episodes) -> np.ndarray:
    """Four numbers (R, 4) that any change of a run's course would change."""
    mu = agent.mu.detach().double().flatten(1)
    parts = [mu.sum(1), mu.square().sum(1), episodes.obs.double().sum(1)]
    return torch.stack([*parts, episodes.returns.mean().double()], 1).numpy()
