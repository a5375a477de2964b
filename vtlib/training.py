"""The loop that everything here runs: act, step, learn."""

import contextlib
import itertools
from collections.abc import Iterator
from typing import Any, Protocol

import torch
from torch import Tensor

from vtlib.replay import Transition


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


@contextlib.contextmanager
def arithmetic() -> Iterator[None]:
    """Compute in float32 with one of torch's threads, and restore the caller's settings afterwards.

    With more threads torch rounds otherwise, and small tensors take longer.
    """
    threads, dtype = torch.get_num_threads(), torch.get_default_dtype()
    torch.set_num_threads(1)
    torch.set_default_dtype(torch.float32)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
        torch.set_default_dtype(dtype)


def iterate(agent: Agent, episodes: Any) -> Iterator[int]:
    """Let an agent act in episodes and learn from each step, for ever; yields the iterations."""
    for t in itertools.count(1):
        agent.learn(episodes.step(agent.act(episodes.obs, episodes.fresh)))
        yield t


def check_finite(mu: Tensor, names: list[str], iteration: int) -> None:
    """Raise Diverged naming the first run whose weights are not finite."""
    bad = ~torch.isfinite(mu).flatten(1).all(1)
    if bad.any():
        first = names[int(bad.nonzero()[0])]
        raise Diverged(f"{first} diverged: its weights are not finite at iteration {iteration}")
