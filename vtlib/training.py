"""The loop that all experiments share: act, step, learn, and record the returns along the way."""

import contextlib
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

from vtlib.episodes import Episodes, GymEpisodes
from vtlib.replay import Transition

FINGERPRINTS = (1, 49, 199)  # iterations within an episode: at its end all runs look alike


class Agent(Protocol):
    """What the loop needs of an algorithm; mu (R, C, d) are the weights of its greedy policy."""

    @property
    def mu(self) -> Tensor: ...

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Actions (R,)."""

    def learn(self, transition: Transition) -> None:
        """Take in one transition of each run."""


class Diverged(RuntimeError):
    """Raised when a run's weights are no longer finite; the message names the run."""


@dataclass
class Curves:
    """Returns of R runs at T recorded iterations, and the runs' fingerprints (R, 3, 4)."""

    iterations: np.ndarray
    learning: np.ndarray
    greedy: np.ndarray
    fingerprints: np.ndarray


@contextlib.contextmanager
def arithmetic() -> Iterator[None]:
    """Compute in float32 with one of torch's threads, and restore the caller's settings afterwards.

    With more threads torch rounds otherwise. Small tensors then take longer, too, many times as
    long where processors are busy.
    """
    threads, dtype = torch.get_num_threads(), torch.get_default_dtype()
    torch.set_num_threads(1)
    torch.set_default_dtype(torch.float32)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
        torch.set_default_dtype(dtype)


def iterate(agent: Agent, episodes: Episodes | GymEpisodes) -> Iterator[int]:
    """The loop that everything here runs: act, step, learn; yields the iterations done, for ever.

    An iteration is one environment step followed by one gradient step.
    """
    for t in itertools.count(1):
        agent.learn(episodes.step(agent.act(episodes.obs, episodes.fresh)))
        yield t


@arithmetic()
def train(
    agent: Agent,
    episodes: Episodes | GymEpisodes,
    evaluate: Callable[[Tensor], Tensor],
    iterations: int,
    every: int,
    names: list[str],
    progress: Callable[[int], bool] | None = None,
) -> Curves:
    """Run the loop for a number of iterations, evaluating every so many of them.

    names (R,) are used in errors. progress is told the iteration at each evaluation and stops the
    loop by returning False. Raises Diverged when weights are not finite.
    """
    times, learning, greedy, prints = [], [], [], []
    for t in itertools.islice(iterate(agent, episodes), iterations):
        if t in FINGERPRINTS:
            prints.append(fingerprint(agent, episodes))
        if t % every == 0:
            check_finite(agent.mu, names, t)
            times.append(t)
            learning.append(episodes.returns.mean().numpy())
            greedy.append(evaluate(agent.mu.cpu()).numpy())
            if progress is not None and not progress(t):
                break
    return curves_of(len(names), times, learning, greedy, prints)


def curves_of(runs: int, times: Any, learning: Any, greedy: Any, prints: Any) -> Curves:
    """Curves of what was recorded of all runs at each time, even if that is nothing."""
    return Curves(
        np.array(times),
        np.array(learning).reshape(-1, runs).T,
        np.array(greedy).reshape(-1, runs).T,
        np.array(prints).reshape(-1, runs, 4).swapaxes(0, 1),
    )


def fingerprint(agent: Agent, episodes: Episodes | GymEpisodes) -> np.ndarray:
    """Four numbers (R, 4) that any change of a run's course would change."""
    mu = agent.mu.detach().cpu().double().flatten(1)
    parts = [mu.sum(1), mu.square().sum(1), episodes.obs.double().sum(1)]
    return torch.stack([*parts, episodes.returns.mean().double()], 1).numpy()


def check_finite(mu: Tensor, names: list[str], iteration: int) -> None:
    """Raise Diverged naming the first run whose weights are not finite."""
    bad = ~torch.isfinite(mu).flatten(1).all(1)
    if bad.any():
        first = names[int(bad.nonzero()[0])]
        raise Diverged(f"{first} diverged: its weights are not finite at iteration {iteration}")
