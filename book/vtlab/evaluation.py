"""The greedy return: what the policy of the mean Q-function earns, on random numbers of its own."""

from collections.abc import Sequence

import torch
from torch import Tensor

from vtlab.envs.base import TaskBatch
from vtlib.qfunctions import QFunction
from vtlib.rng import Rng


class Evaluation:
    """Mean discounted return (R,) of ``episodes`` episodes of each run's greedy policy.

    Of several weights of a run Q takes the "mean", or the "max" at each action (generalised policy
    improvement), or "each" plays the same episodes and their returns are averaged. An evaluation
    always draws as many random numbers, from streams of its own, and so leaves the learning alone.
    """

    def __init__(
        self, q: QFunction, tasks: TaskBatch, rng: Rng, episodes: int = 10, over: str = "mean"
    ) -> None:
        self._q, self._episodes, self._over = q, episodes, over
        self._noise, self._starts = rng.stream("test noise"), rng.stream("test start")
        self._runs = len(tasks)
        self._tasks = tasks.select(torch.arange(self._runs).repeat_interleave(episodes))

    def keep(self, rows: Sequence[int]) -> None:
        """Go on with some of the runs, by their places in the batch, in that order."""
        self._noise.keep(rows)
        self._starts.keep(rows)
        self._runs = len(rows)
        copies = torch.tensor(rows).unsqueeze(1) * self._episodes + torch.arange(self._episodes)
        self._tasks = self._tasks.select(copies.flatten())

    def __call__(self, mu: Tensor) -> Tensor:
        """Evaluate means mu (R, C, d)."""
        return self.episodes(mu).mean(1)

    def episodes(self, mu: Tensor) -> Tensor:
        """The return (R, episodes) of each episode by itself."""
        tasks, copies = self._tasks, self._runs * self._episodes
        noise = self._noise.normal(self._episodes * tasks.horizon * tasks.noise_dim)
        noise = noise.reshape(copies, tasks.horizon, tasks.noise_dim)
        starts = self._starts.uniform(self._episodes * tasks.start_dim)
        start = tasks.start(starts.reshape(copies, tasks.start_dim))
        parts = mu.split(1, 1) if self._over == "each" else (mu,)
        return torch.stack([self._play(part, start, noise) for part in parts]).mean(0)

    def _play(self, mu: Tensor, state: Tensor, noise: Tensor) -> Tensor:
        """The returns (R, episodes) of greedy policies from states, with the noise of each step."""
        tasks, copies = self._tasks, len(state)
        alive, total, discount = torch.ones(copies), torch.zeros(copies), 1.0
        for h in range(tasks.horizon):
            action = self._greedy(mu, tasks.observe(state))
            state, reward, terminated = tasks.step(state, action, noise[:, h])
            total.add_(reward * alive, alpha=discount)
            alive *= ~terminated
            discount *= tasks.gamma
            if not alive.any():
                break
        return total.view(self._runs, self._episodes)

    def _greedy(self, mu: Tensor, obs: Tensor) -> Tensor:
        values = self._q.q(mu, self._q.prepare(obs.view(self._runs, self._episodes, -1)))
        values = values.amax(1) if self._over == "max" else values.mean(1)
        return values.argmax(1).view(-1)
