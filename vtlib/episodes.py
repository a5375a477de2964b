"""Episodes of many tasks in lock-step: each run starts a new one as soon as its own ends."""

from collections.abc import Sequence
from typing import Any, ClassVar, Protocol

import gymnasium
import numpy as np
import torch
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple
from torch import Tensor

from vtlib.checks import check_kind, shown
from vtlib.replay import Transition
from vtlib.rng import Stream

# gymnasium.wrappers.FlattenObservation makes one Box of these spaces, unless they hold others
FLATTENED = Box, Discrete, MultiDiscrete, MultiBinary, Dict, Tuple


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
        """First states from uniform numbers (R, start_dim) in [0, 1)."""

    def step(self, state: Tensor, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Next state, reward (R,), terminated (R,), from normal noise (R, noise_dim)."""

    def observe(self, state: Tensor) -> Tensor:
        """Observations (R, obs_dim)."""

    def select(self, index: Tensor | np.ndarray | Sequence[int]) -> "Tasks":
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

    def mean(self, before: float = 0.0) -> Tensor:
        """Mean return (R,) of the last episodes; ``before`` until the first one has ended."""
        mean = self._finished.sum(1) / self._count.clamp(1, self._finished.shape[1])
        return torch.where(self._count > 0, mean, before)


class Episodes:
    """A batch of tasks in lock-step, with the returns of each run's last ``window`` episodes.

    ``obs`` (R, obs_dim) is what the agents see now, ``fresh`` (R,) marks first steps. To ``record``
    is to keep every observation arrived at in ``visited``.
    """

    def __init__(
        self,
        tasks: Tasks,
        noise: Stream,
        starts: Stream,
        window: int = 50,
        record: bool = False,
    ) -> None:
        self._tasks, self._noise, self._starts = tasks, noise, starts
        self._state = tasks.start(starts.uniform(tasks.start_dim))
        self._time = torch.zeros(len(tasks), dtype=torch.int64)
        self.returns = Returns(len(tasks), tasks.gamma, window)
        self.obs = tasks.observe(self._state)
        self.obs_dim, self.n_actions = tasks.obs_dim, tasks.n_actions
        self.fresh = torch.ones(len(tasks), dtype=torch.bool)
        self._record = record
        self._arrived: list[Tensor] = []

    def step(self, action: Tensor) -> Transition:
        """Apply actions (R,) and return the transitions; runs whose episode ended start anew."""
        tasks = self._tasks
        start = self._starts.uniform(tasks.start_dim)
        noise = self._noise.normal(tasks.noise_dim)
        state, reward, terminated = tasks.step(self._state, action, noise)
        next_obs = tasks.observe(state)
        transition = Transition(self.obs, action, reward, next_obs, terminated)
        if self._record:
            self._arrived.append(next_obs)
        self._time += 1
        self.fresh = terminated | (self._time >= tasks.horizon)
        self.returns.add(reward, self.fresh)
        self._state, self.obs = state, next_obs
        if self.fresh.any():
            self._state = torch.where(self.fresh.unsqueeze(-1), tasks.start(start), state)
            self._time.masked_fill_(self.fresh, 0)
            self.obs = tasks.observe(self._state)
        return transition

    @property
    def visited(self) -> Tensor:
        """Observations arrived at so far, ends of episodes included: (R, T, obs_dim)."""
        return torch.stack(self._arrived, 1)

    def keep(self, rows: Sequence[int]) -> None:
        """Go on with some of the runs, by their places in the batch, in that order."""
        for part in (self._noise, self._starts, self.returns):
            part.keep(rows)
        self._tasks = self._tasks.select(rows)
        self._state, self._time = self._state[rows], self._time[rows]
        self.obs, self.fresh = self.obs[rows], self.fresh[rows]
        self._arrived = [obs[rows] for obs in self._arrived]


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
        sizes = {_sizes(env) for env in envs}
        if len(sizes) != 1:
            raise ValueError(f"environments must have the same spaces, got {sorted(sizes)}")
        ((self.obs_dim, self.n_actions),) = sizes
        self.first_action = int(getattr(envs[0].action_space, "start", 0))
        self._envs: list[Any] = list(envs)
        pairs = zip(envs, seeds, strict=True)
        first = [self._observation(env, env.reset(seed=int(seed))[0]) for env, seed in pairs]
        self.obs = torch.from_numpy(np.stack(first))
        self.returns = Returns(len(envs), gamma, window)
        self.fresh = torch.ones(len(envs), dtype=torch.bool)

    def step(self, action: Tensor) -> Transition:
        """Apply actions (R,) and return the transitions; runs whose episode ended start anew."""
        after, current, reward, ended, over = [], [], [], [], []
        for env, a in zip(self._envs, action.tolist(), strict=True):
            outcome = env.step(a + int(env.action_space.start))
            if len(outcome) != 5:
                rule = "step must return obs, reward, terminated, truncated, info"
                raise ValueError(f"{rule} (Gymnasium's five), got {len(outcome)} from {env}")
            obs, r, terminated, truncated, _ = outcome
            after.append(self._observation(env, obs))
            reward.append(float(r))
            if not np.isfinite(reward[-1]):
                raise ValueError(f"rewards must be finite, {env} gave {r}")
            ended.append(bool(terminated))
            over.append(bool(terminated or truncated))
            current.append(self._observation(env, env.reset()[0]) if over[-1] else after[-1])
        arrived = torch.from_numpy(np.stack(after))
        transition = Transition(
            self.obs, action, torch.tensor(reward), arrived, torch.tensor(ended)
        )
        self.obs, self.fresh = torch.from_numpy(np.stack(current)), torch.tensor(over)
        self.returns.add(transition.reward, self.fresh)
        return transition

    def _observation(self, env: gymnasium.Env, obs: np.ndarray) -> np.ndarray:
        numbers = np.array(obs, np.float32)  # a copy: the environment may reuse its array
        if numbers.shape != (self.obs_dim,) or not np.isfinite(numbers).all():
            raise ValueError(f"needs {self.obs_dim} finite numbers to see, {env} gave {obs}")
        return numbers


def check_environment(env: object) -> None:
    """Raise ValueError unless env is an environment of its own."""
    if isinstance(env, gymnasium.vector.VectorEnv):
        raise ValueError(f"envs must be single environments, got {shown(env)}: pass its .envs")
    check_kind("each of envs", env, gymnasium.Env)


def _flattens(space: gymnasium.Space[Any]) -> bool:
    try:
        return isinstance(space, FLATTENED) and space.is_np_flattenable
    except NotImplementedError:
        # A space from elsewhere, such as that of MiniGrid's missions, may leave the question open.
        # FlattenObservation fails on it, so the advice to use it would be wrong.
        return False


def _flattening(space: gymnasium.Space[Any]) -> str:
    """What makes one Box of a space, as the end of an error; nothing where nothing does."""
    if _flattens(space):
        image = isinstance(space, Box) and len(space.shape) == 3 and min(space.shape[:2]) > 16
        first = "GrayscaleObservation and ResizeObservation make it small, and " if image else ""
        return f"; {first}gymnasium.wrappers.FlattenObservation makes one of it"
    kept = [x for x, part in getattr(space, "spaces", {}).items() if _flattens(part)]
    if isinstance(space, Dict) and kept:
        return f"; FlattenObservation(FilterObservation(env, {kept})) makes one of a part of it"
    return ""


def _sizes(env: gymnasium.Env) -> tuple[int, int]:
    """Numbers of an observation and of actions; ValueError for spaces of another kind."""
    check_environment(env)
    box, discrete = env.observation_space, env.action_space
    if not (isinstance(box, Box) and len(box.shape) == 1):
        remedy = _flattening(box)
        raise ValueError(f"needs a one-dimensional Box observation space, got {box}{remedy}")
    if not isinstance(discrete, Discrete):
        remedy = "gymnasium.wrappers.TransformAction can map a few numbers to actions"
        need = f"needs a Discrete action space, got {discrete}"
        raise ValueError(f"{need}, for each action has a value: {remedy}")
    return box.shape[0], int(discrete.n)
