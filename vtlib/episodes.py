"""Episodes of many environments in lock-step: each run starts a new one when its own ends."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.spaces import Box, Discrete
from torch import Tensor

from vtlib.replay import Transition


class Returns:
    """Discounted returns of the last ``window`` finished episodes of each run."""

    def __init__(self, runs: int, gamma: float, window: int = 50) -> None:
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


class GymEpisodes:
    """Ordinary Gymnasium environments in lock-step, one for each run.

    ``obs`` (R, obs_dim) is what the agents see now, ``fresh`` (R,) marks first steps.
    Each needs a Box observation space of one dimension and a Discrete action space; ValueError
    otherwise. Run i is reset with seeds[i] once, and continues its own stream afterwards.
    """

    def __init__(
        self, envs: Sequence[gymnasium.Env], seeds: Sequence[int], gamma: float = 0.99
    ) -> None:
        if not envs:
            raise ValueError("envs must be at least one, got none")
        sizes = {_sizes(env) for env in envs}
        if len(sizes) != 1:
            raise ValueError(f"environments must have the same spaces, got {sorted(sizes)}")
        ((self.obs_dim, self.n_actions),) = sizes
        self.first_action = int(getattr(envs[0].action_space, "start", 0))
        self._envs: list[Any] = list(envs)
        pairs = zip(envs, seeds, strict=True)
        first = [self._observation(env, env.reset(seed=int(seed))[0]) for env, seed in pairs]
        self.obs = torch.from_numpy(np.stack(first))
        self.returns = Returns(len(envs), gamma)
        self.fresh = torch.ones(len(envs), dtype=torch.bool)

    def step(self, action: Tensor) -> Transition:
        """Apply actions (R,) and return the transitions; runs whose episode ended start anew."""
        after, current, reward, ended, over = [], [], [], [], []
        for env, a in zip(self._envs, action.tolist(), strict=True):
            obs, r, terminated, truncated, _ = env.step(a + int(env.action_space.start))
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


def _sizes(env: gymnasium.Env) -> tuple[int, int]:
    """Numbers of an observation and of actions; ValueError for spaces of another kind."""
    box, discrete = env.observation_space, env.action_space
    if not (isinstance(box, Box) and len(box.shape) == 1):
        remedy = "gymnasium.wrappers.FlattenObservation makes one of most"
        raise ValueError(f"needs a one-dimensional Box observation space, got {box}; {remedy}")
    if not isinstance(discrete, Discrete):
        remedy = "gymnasium.wrappers.TransformAction can map a few numbers to actions"
        need = f"needs a Discrete action space, got {discrete}"
        raise ValueError(f"{need}, for each action has a value: {remedy}")
    return box.shape[0], int(discrete.n)
