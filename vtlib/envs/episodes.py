"""Episodes of many tasks in lock-step: each run starts a new one as soon as its own ends."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Protocol

import gymnasium
import numpy as np
import torch
from torch import Tensor

from vtlib.checks import check_kind
from vtlib.replay import Transition
from vtlib.streams import Stream


class Tasks(Protocol):
    """A batch of R tasks with the dynamics as pure functions of state, action and noise."""

    n_actions: ClassVar[int]
    obs_dim: ClassVar[int]
    noise_dim: ClassVar[int]
    start_dim: ClassVar[int]
    horizon: ClassVar[int]
    gamma: ClassVar[float]

    def __len__(self) -> int: ...

    def start(self, u: Tensor) -> Tensor:
        """Initial states from uniforms (R, start_dim)."""

    def step(self, state: Tensor, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Next state, reward and terminal flag, from standard normal noise (R, noise_dim)."""

    def observe(self, state: Tensor) -> Tensor:
        """Observations (R, obs_dim)."""

    def select(self, index: Tensor | np.ndarray | Sequence[int]) -> Tasks:
        """The tasks of that index, repetitions allowed."""


class Returns:
    """Discounted returns of the last finished episodes of each run."""

    def __init__(self, runs: int, gamma: float, window: int) -> None:
        self._gamma = gamma
        self._finished = torch.zeros(runs, window)
        self._count = torch.zeros(runs, dtype=torch.int64)
        self._running = torch.zeros(runs)
        self._discount = torch.ones(runs)

    def add(self, reward: Tensor, done: Tensor) -> None:
        """Account for one reward of each run; done (R,) ends its episode."""
        self._running.addcmul_(self._discount, reward)
        self._discount.mul_(self._gamma)
        if done.any():
            rows = done.nonzero().squeeze(1)
            self._finished[rows, self._count[rows] % self._finished.shape[1]] = self._running[rows]
            self._count[rows] += 1
            self._running[rows] = 0.0
            self._discount[rows] = 1.0

    def keep(self, rows: Sequence[int]) -> None:
        """Go on with some of the runs, by their places in the batch, in that order."""
        self._finished, self._count = self._finished[rows], self._count[rows]
        self._running, self._discount = self._running[rows], self._discount[rows]

    def mean(self) -> Tensor:
        """Mean return (R,) of the last episodes, zero before the first one has ended."""
        return self._finished.sum(1) / self._count.clamp(1, self._finished.shape[1])


class Episodes:
    """Tasks of this library in lock-step, with the learning return of each run.

    ``obs`` (R, obs_dim) is what the agents see now, ``fresh`` (R,) marks first steps. The learning
    return is the mean discounted return of the last ``window`` finished episodes.
    """

    def __init__(self, tasks: Tasks, noise: Stream, starts: Stream, window: int = 50) -> None:
        self._tasks, self._noise, self._starts = tasks, noise, starts
        self._state = tasks.start(starts.uniform(tasks.start_dim))
        self._time = torch.zeros(len(tasks), dtype=torch.int64)
        self.returns = Returns(len(tasks), tasks.gamma, window)
        self.obs = tasks.observe(self._state)
        self.obs_dim, self.n_actions = tasks.obs_dim, tasks.n_actions
        self.fresh = torch.ones(len(tasks), dtype=torch.bool)

    def step(self, action: Tensor) -> Transition:
        """Apply actions (R,) and return the transitions; runs whose episode ended start anew."""
        tasks = self._tasks
        start = self._starts.uniform(tasks.start_dim)
        state, reward, terminal = tasks.step(
            self._state, action, self._noise.normal(tasks.noise_dim)
        )
        next_obs = tasks.observe(state)
        transition = Transition(self.obs, action, reward, next_obs, terminal)
        self._time += 1
        self.fresh = terminal | (self._time >= tasks.horizon)
        self.returns.add(reward, self.fresh)
        self._state, self.obs = state, next_obs
        if self.fresh.any():
            self._state = torch.where(self.fresh.unsqueeze(-1), tasks.start(start), state)
            self._time.masked_fill_(self.fresh, 0)
            self.obs = tasks.observe(self._state)
        return transition

    def keep(self, rows: Sequence[int]) -> None:
        """Go on with some of the runs, by their places in the batch, in that order."""
        for part in (self._noise, self._starts, self.returns):
            part.keep(rows)
        self._tasks = self._tasks.select(rows)
        self._state, self._time = self._state[rows], self._time[rows]
        self.obs, self.fresh = self.obs[rows], self.fresh[rows]


class RecordedEpisodes(Episodes):
    """Episodes that keep every state they arrive at."""

    def __init__(self, tasks: Tasks, noise: Stream, starts: Stream, window: int = 50) -> None:
        super().__init__(tasks, noise, starts, window)
        self._arrived: list[Tensor] = []

    def step(self, action: Tensor) -> Transition:
        """Apply actions (R,) and keep where they lead."""
        transition = super().step(action)
        self._arrived.append(transition.next_obs)
        return transition

    @property
    def visited(self) -> Tensor:
        """Observations arrived at so far, (R, T, obs_dim)."""
        return torch.stack(self._arrived, 1)


class GymEpisodes:
    """Ordinary Gymnasium environments in lock-step, one for each run, behind the same interface.

    Each needs a Box observation space of one dimension and a Discrete action space; ValueError
    otherwise. Run i is reset with seeds[i] once, and continues its own stream afterwards.
    """

    def __init__(
        self,
        envs: Sequence[gymnasium.Env],
        seeds: Sequence[int],
        gamma: float = 0.99,
        window: int = 50,
    ) -> None:
        if not envs:
            raise ValueError("there must be at least one environment")
        checked = [_checked_spaces(env) for env in envs]
        self._envs = list(envs)
        self._first_actions = [int(discrete.start) for _, discrete in checked]
        spaces = {(box.shape, int(discrete.n)) for box, discrete in checked}
        if len(spaces) != 1:
            raise ValueError(f"environments must have the same spaces, got {sorted(spaces)}")
        first = [env.reset(seed=int(s))[0] for env, s in zip(envs, seeds, strict=True)]
        self.obs = _stack(first)
        self.obs_dim, self.n_actions = self.obs.shape[1], int(checked[0][1].n)
        self.returns = Returns(len(envs), gamma, window)
        self.fresh = torch.ones(len(envs), dtype=torch.bool)

    def step(self, action: Tensor) -> Transition:
        """Apply actions (R,) and return the transitions; runs whose episode ended start anew."""
        after, current, reward, terminal, done = [], [], [], [], []
        actions = zip(self._envs, self._first_actions, action.tolist(), strict=True)
        for env, first, a in actions:
            obs, r, terminated, truncated, _ = env.step(a + first)
            # copied: an environment may hand out one array again and again
            after.append(np.array(obs, np.float32))
            reward.append(float(r))
            terminal.append(bool(terminated))
            done.append(bool(terminated or truncated))
            current.append(env.reset()[0] if done[-1] else obs)
        transition = Transition(
            self.obs, action, torch.tensor(reward), _stack(after), torch.tensor(terminal)
        )
        self.obs, self.fresh = _stack(current), torch.tensor(done)
        self.returns.add(transition.reward, self.fresh)
        return transition


def _checked_spaces(env: gymnasium.Env) -> tuple[gymnasium.spaces.Box, gymnasium.spaces.Discrete]:
    check_kind("each environment", env, gymnasium.Env)
    box, discrete = env.observation_space, env.action_space
    if not (isinstance(box, gymnasium.spaces.Box) and len(box.shape) == 1):
        raise ValueError(f"needs a one-dimensional Box observation space, got {box}")
    if not isinstance(discrete, gymnasium.spaces.Discrete):
        raise ValueError(f"needs a Discrete action space, got {discrete}")
    return box, discrete


def _stack(observations: Sequence[np.ndarray]) -> Tensor:
    return torch.from_numpy(np.stack(observations).astype(np.float32))
