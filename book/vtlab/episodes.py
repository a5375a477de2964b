"""Episodes of a batch of tasks in lock-step, behind the interface of ``vtlib.episodes``."""

from collections.abc import Sequence

import torch
from torch import Tensor

from vtlab.envs.base import TaskBatch
from vtlib.episodes import Returns
from vtlib.replay import Transition
from vtlib.rng import Stream


class Episodes:
    """A batch of tasks in lock-step, with the returns of each run's last ``window`` episodes.

    ``obs`` (R, obs_dim) is what the agents see now, ``fresh`` (R,) marks first steps. To ``record``
    is to keep every observation arrived at in ``visited``.
    """

    def __init__(
        self,
        tasks: TaskBatch,
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
