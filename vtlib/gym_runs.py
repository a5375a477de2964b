"""Solve and transfer between ordinary Gymnasium environments, one call each."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from typing import NamedTuple

import gymnasium
import numpy as np
import torch
from torch import Tensor

from vtlib.baselines import MellowTDSettings
from vtlib.checks import check_kind, check_weights, check_whole
from vtlib.envs.episodes import GymEpisodes
from vtlib.qfunctions import QFunction
from vtlib.rng import Rng, generator
from vtlib.training import Agent, check_finite, iterate
from vtlib.transfer import Settings


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
    episodes, rng = _episodes(envs, q, name), Rng(name, range(len(envs)))
    start = 0.1 * Rng(name, [0]).stream("initial weights").normal(q.d).expand(len(envs), -1)
    return _learn(settings.agent(q, start, episodes.obs_dim, rng), episodes, iterations, name)


def transfer(
    envs: Sequence[gymnasium.Env],
    q: QFunction,
    sources: Tensor,
    iterations: int,
    settings: Settings | None = None,
    name: str = "transfer",
) -> Learned:
    """Learn each environment with a prior from solved sources (S, d): Algorithm 1.

    Derives and raises as ``solve``, also for sources that are missing, not finite or not of the
    Q-function's shape.
    """
    check_whole("iterations", iterations)
    check_kind("sources", sources, Tensor)
    check_weights("sources", sources, "source", q.d)
    episodes, rng = _episodes(envs, q, name), Rng(name, range(len(envs)))
    shared = sources.detach().expand(len(envs), *sources.shape)
    agent = (settings or Settings()).agent(q, shared, episodes.obs_dim, rng)
    return _learn(agent, episodes, iterations, name)


def _episodes(envs: Sequence[gymnasium.Env], q: QFunction, name: str) -> GymEpisodes:
    check_kind("envs", envs, Sequence)
    limit, runs = np.iinfo(np.int32).max, range(len(envs))
    seeds = [int(generator(name, run, "environment").integers(limit)) for run in runs]
    episodes = GymEpisodes(envs, seeds)
    if q.n_actions != episodes.n_actions:
        raise ValueError(
            f"the Q-function must have the environments' {episodes.n_actions} actions, "
            f"got {q.n_actions}"
        )
    return episodes


def _learn(agent: Agent, episodes: GymEpisodes, iterations: int, name: str) -> Learned:
    returns = []
    for t in islice(iterate(agent, episodes), iterations):
        if t % 100 == 0:
            check_finite(agent.mu, [f"run {r} of {name}" for r in range(len(agent.mu))], t)
            returns.append(episodes.returns.mean())
    return Learned(agent.mu.detach(), torch.stack(returns, 1) if returns else torch.empty(0))
