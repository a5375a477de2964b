"""Greedy play on ordinary Gymnasium environments, and what the front door refuses of them."""

from collections.abc import Sequence

import gymnasium
import numpy as np
import torch
from torch import Tensor

from vtlib.checks import check_between, check_kind, check_weights, check_whole, shown
from vtlib.episodes import GymEpisodes
from vtlib.qfunctions import QFunction
from vtlib.rng import generator
from vtlib.training import arithmetic

LONGEST = 100_000  # steps after which an episode is given up


@arithmetic()
def evaluate(
    envs: Sequence[gymnasium.Env],
    q: QFunction,
    weights: Tensor,
    episodes: int = 20,
    *,
    gamma: float = 0.99,
    seed: int = 0,
) -> Tensor:
    """Discounted returns (R, episodes) of greedy policies on fresh episodes.

    The values of C weight vectors of weights (R, C, d) are averaged. Raises as ``solve``.
    """
    check_whole("episodes", episodes)
    check_between("gamma", gamma, 0, 1)
    check_whole("seed", seed, 0)
    lock = episodes_of(envs, q, f"evaluate {seed}", gamma)
    check_weights("weights", weights, len(envs), "component", q.d)
    runs = len(weights)
    running, discount = torch.zeros(runs), torch.ones(runs)
    count = torch.zeros(runs, dtype=torch.int64)
    since = torch.zeros_like(count)
    returns = torch.zeros(runs, episodes)
    while bool((count < episodes).any()):
        action = q.q(weights, q.prepare(lock.obs.unsqueeze(1))).mean(1)[..., 0].argmax(-1)
        running += discount * lock.step(action).reward
        discount *= gamma
        since += 1
        for row in (lock.fresh & (count < episodes)).nonzero().flatten().tolist():
            returns[row, count[row]] = running[row]
            count[row] += 1
        running[lock.fresh], discount[lock.fresh], since[lock.fresh] = 0.0, 1.0, 0
        if int(since.max()) > LONGEST:
            fault = f"envs must end their episodes, got {LONGEST:,} steps without an end"
            raise ValueError(f"{fault}: gymnasium.wrappers.TimeLimit ends them")
    return returns


def episodes_of(
    envs: Sequence[gymnasium.Env], q: QFunction, name: str, gamma: float
) -> GymEpisodes:
    """Environments in lock-step; ValueError where the Q-function does not fit them."""
    if isinstance(envs, gymnasium.vector.VectorEnv):
        raise ValueError(f"envs must be a Sequence, got {shown(envs)}: pass its .envs")
    if isinstance(envs, str) or not isinstance(envs, Sequence):
        raise ValueError(f"envs must be a list, such as [env], got {shown(envs)}")
    for env in envs:
        check_kind("each of envs", env, gymnasium.Env)
    check_kind("q", q, QFunction)
    if len({id(env.unwrapped) for env in envs}) < len(envs):
        raise ValueError("envs must be one for each run, got one that is given twice")
    limit, runs = np.iinfo(np.int32).max, range(len(envs))
    seeds = [int(generator(name, run, "environment").integers(limit)) for run in runs]
    episodes = GymEpisodes(envs, seeds, gamma)
    try:
        values = q.q(torch.zeros(1, 1, q.d), q.prepare(episodes.obs[:1].unsqueeze(1)))
    except Exception as error:  # a user's Q-function may raise anything
        need = f"q must value an observation of {episodes.obs_dim} numbers"
        raise ValueError(f"{need}, got {shown(str(error))}") from error
    if not (values.shape[:2] == (1, 1) and values.shape[2] == q.n_actions == episodes.n_actions):
        counts = f"{episodes.n_actions} actions, got {q.n_actions} and {values.shape[2]} values"
        raise ValueError(f"q must have the environments' {counts}")
    return episodes
