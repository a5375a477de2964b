"""Coverage of the planned optimal values by rooms posteriors, looked at while they learn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from vtlib.coverage import inside, posterior_samples
from vtlib.domains import domain
from vtlib.envs.episodes import Tasks
from vtlib.envs.rooms import SIDE, Rooms
from vtlib.experiments.experiment import Experiment
from vtlib.planning import plan
from vtlib.streams import Stream
from vtlib.training import Agent
from vtlib.transfer import VariationalTransfer

SAMPLES = 400  # of each component's posterior


class CoverageProbe:
    """Random pairs of state and action of each run's task, looked at while the runs learn.

    States are uniform in the square, actions uniform; the truth is the planned optimal value.
    """

    def __init__(self, experiment: Experiment, runs: Sequence[int], tasks: Tasks) -> None:
        assert isinstance(tasks, Rooms)
        count = experiment.probes
        u = Stream(experiment.stream, runs, "probes").uniform(3 * count).view(len(runs), count, 3)
        self._q = domain(experiment.family).q()
        self._obs = SIDE * u[..., :2]
        self._action = (u[..., 2] * Rooms.n_actions).long()
        self._truth = torch.stack([self._planned(tasks, i) for i in range(len(runs))])
        self._noise = Stream(experiment.stream, runs, "probe samples")
        self._seen: list[Tensor] = []

    def _planned(self, tasks: Rooms, index: int) -> Tensor:
        # endless: a transition that the horizon cuts off is bootstrapped like any other
        values = plan(tasks, index, None).q(self._obs[index])
        return values.gather(1, self._action[index].unsqueeze(1)).squeeze(1)

    def look(self, agent: Agent) -> None:
        """Note the coverage of the present posterior."""
        assert isinstance(agent, VariationalTransfer)
        runs, components, d = agent.mu.shape
        noise = self._noise.normal(components * SAMPLES * d).view(runs, components, SAMPLES, d)
        weights = posterior_samples(agent.mu.detach(), agent.L, noise)
        self._seen.append(inside(self._q, weights, self._obs, self._action, self._truth))

    @property
    def shares(self) -> np.ndarray:
        """Shares (R, T, levels) at the T looks so far."""
        return torch.stack(self._seen, 1).numpy()
