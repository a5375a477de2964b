"""Solve and transfer between ordinary Gymnasium environments, one call each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import gymnasium
import numpy as np
import torch
from torch import Tensor

from vtlib.baselines import MellowTD, MellowTDSettings
from vtlib.checks import check_kind, check_weights, check_whole
from vtlib.envs.episodes import GymEpisodes
from vtlib.qfunctions import QFunction
from vtlib.streams import Stream, generator
from vtlib.training import Agent, check_finite
from vtlib.transfer import Settings, VariationalTransfer


class Learned(NamedTuple):
    """What runs on R environments end with.

    weights (R, C, d): final weights, of each component's mean for a posterior. returns (R, T): mean
    discounted return of the last 50 episodes, every 100 iterations.
    """

    weights: Tensor
    returns: Tensor


def solve(
    envs: Sequence[gymnasium.Env],
    q: QFunction,
    iterations: int,
    settings: MellowTDSettings | None = None,
    name: str = "solve",
) -> Learned:
    """Learn each environment from scratch by mellow TD, all from one common initialisation.

    A common start keeps the hidden units of a network comparable between sources. Everything
    random derives from ``name``. Raises ValueError for spaces other than Box and Discrete, and for
    a Q-function with another number of observations or actions.
    """
    check_whole("iterations", iterations)
    settings = settings or MellowTDSettings(epsilon_steps=max(1, iterations // 2))
    episodes = _episodes(envs, q, name)
    runs = range(len(envs))
    start = 0.1 * Stream(name, [0], "initial weights").normal(q.d).expand(len(envs), -1)
    streams = (Stream(name, runs, role) for role in ("exploration", "replay"))
    return _learn(
        MellowTD(q, start, episodes.obs_dim, settings, *streams), episodes, iterations, name
    )


def transfer(
    envs: Sequence[gymnasium.Env],
    q: QFunction,
    sources: Tensor,
    iterations: int,
    settings: Settings | None = None,
    name: str = "transfer",
) -> Learned:
    """Learn each environment with a prior from solved sources (S, d): Algorithm 1.

    Everything random derives from ``name``. Raises ValueError for spaces other than Box and
    Discrete, for a Q-function with another number of observations or actions, and for sources that
    are missing, not finite or not of the Q-function's shape.
    """
    check_whole("iterations", iterations)
    check_kind("sources", sources, Tensor)
    check_weights("sources", sources, "source", q.d)
    episodes = _episodes(envs, q, name)
    runs = range(len(envs))
    shared = sources.detach().expand(len(envs), *sources.shape)
    streams = (Stream(name, runs, role) for role in ("posterior", "component", "replay"))
    agent = VariationalTransfer(q, shared, episodes.obs_dim, settings or Settings(), *streams)
    return _learn(agent, episodes, iterations, name)


def _episodes(envs: Sequence[gymnasium.Env], q: QFunction, name: str) -> GymEpisodes:
    check_kind("envs", envs, Sequence)
    episodes = GymEpisodes(envs, _seeds(name, len(envs)))
    if q.n_actions != episodes.n_actions:
        raise ValueError(
            f"the Q-function must have the environments' {episodes.n_actions} actions, "
            f"got {q.n_actions}"
        )
    return episodes


def _learn(agent: Agent, episodes: GymEpisodes, iterations: int, name: str) -> Learned:
    returns = []
    for t in range(1, iterations + 1):
        agent.learn(episodes.step(agent.act(episodes.obs, episodes.fresh)))
        if t % 100 == 0:
            check_finite(agent.mu, [f"run {r} of {name}" for r in range(len(agent.mu))], t)
            returns.append(episodes.returns.mean())
    return Learned(agent.mu.detach(), torch.stack(returns, 1) if returns else torch.empty(0))


def _seeds(name: str, count: int) -> list[int]:
    limit = np.iinfo(np.int32).max
    return [int(generator(name, run, "environment").integers(limit)) for run in range(count)]
