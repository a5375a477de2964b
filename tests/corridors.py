"""An experiment of one's own: an environment, its record, and a posterior.

A corridor whose goal is on the left or on the right, and an isotropic posterior of fixed width,
which one line makes known. With ``ours = corridors:EXPERIMENTS`` among the entry points
*vtlab.experiments* of its package, ``python -m vtlab run ours`` computes its sources and runs.
"""

import torch
from attrs import frozen

from vtlab.envs.base import TaskBatch, TaskFamily
from vtlab.experiment import Experiment, Pool
from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.posteriors import COVARIANCES
from vtlib.qfunctions import MLP
from vtlib.transfer import Settings


@frozen(eq=False)
class Corridors(TaskBatch):
    """From the middle of a corridor to an end of each task's own, left or right."""

    goal: torch.Tensor  # (R,) float32, -1 or 1

    parameters = ("goal",)
    n_actions, obs_dim, state_dim, noise_dim, start_dim, horizon, gamma = 2, 1, 1, 1, 1, 20, 0.9

    def start(self, u):
        return 0.2 * u - 0.1

    def step(self, state, action, noise):
        moved = state + 0.25 * (2 * action.unsqueeze(1) - 1) + 0.01 * noise
        arrived = (moved * self.goal.unsqueeze(1) >= 1).squeeze(1)
        return moved.clamp(-1, 1), arrived.float(), arrived


@frozen
class CorridorFamily(TaskFamily):
    parameters = ("goal",)
    limits = (0.0, 1.0)

    def q(self):
        return MLP((1, 8, 2))

    def optimum(self, tasks):
        return torch.full((len(tasks),), Corridors.gamma**3)

    def sample(self, rng, count):
        return Corridors(torch.where(torch.from_numpy(rng.random(count)) < 0.9, 1.0, -1.0))


class Isotropic:
    """w = mu + sigma z, with the one sigma that it began with."""

    def __init__(self, start, precision, descent, noise, n_samples):
        self.mu, self._sigma, self._noise = start.mu, start.variance**0.5, noise
        self._shape = torch.Size([*self.mu.shape[:2], n_samples, self.mu.shape[2]])

    def sample(self):
        draws = self._noise.normal(self._shape[1:].numel()).view(self._shape)
        return self.mu.unsqueeze(2) + self._sigma * draws

    def step(self, gradients, kl_weight):
        assert gradients.shape[2] < self._shape[2]

    @property
    def scale_tril(self):
        return torch.diag_embed(torch.full_like(self.mu, self._sigma))


COVARIANCES["isotropic"] = Isotropic
LEARNER = MellowTDSettings(epsilon_steps=100, gamma=0.9, minibatch=10)
LENGTH = {"iterations": 200, "limit": 400, "check_every": 100, "episodes": 5}
POOL = Pool("corridors", CorridorFamily(), count=3, settings=LEARNER, **LENGTH)
ALGORITHMS = {
    "GVT": Settings("gaussian", covariance="isotropic", lambda_=1e-3, gamma=0.9, n_samples=3),
    "NT": DDQNSettings(epsilon_steps=100, gamma=0.9),
}
SIZE = {"runs": 2, "sources": 2, "iterations": 200, "every": 100}
EXPERIMENTS = {"mine": Experiment("mine", POOL, POOL.family, ALGORITHMS, **SIZE)}
