"""Coverage of planned values by rooms posteriors, looked at while they learn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from vtlib.coverage import inside, posterior_samples, values_at
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

    States are uniform in the square, actions uniform. There are two truths: the planned optimal
    value, and the one planned with mellowmax, which is what the algorithms' TD errors ask for.
    """

    def __init__(
        self, experiment: Experiment, runs: Sequence[int], tasks: Tasks, kappa: float
    ) -> None:
        assert isinstance(tasks, Rooms)
        count = experiment.probes
        u = Stream(experiment.stream, runs, "probes").uniform(3 * count).view(len(runs), count, 3)
        self._q = domain(experiment.family).q()
        self._obs = SIDE * u[..., :2]
        self._action = (u[..., 2] * Rooms.n_actions).long()
        each = [[self._planned(tasks, i, k) for i in range(len(runs))] for k in (None, kappa)]
        self._truths = torch.stack([torch.stack(rows) for rows in each])
        self._noise = Stream(experiment.stream, runs, "probe samples")
        self._inside: list[Tensor] = []
        self._off: list[Tensor] = []

    def _planned(self, tasks: Rooms, index: int, kappa: float | None) -> Tensor:
        # endless: a transition that the horizon cuts off is bootstrapped like any other
        values = plan(tasks, index, None, kappa=kappa).q(self._obs[index])
        return values.gather(1, self._action[index].unsqueeze(1)).squeeze(1)

    def look(self, agent: Agent) -> None:
        """Note the coverage and the error of the present posterior."""
        assert isinstance(agent, VariationalTransfer)
        runs, components, d = agent.mu.shape
        noise = self._noise.normal(components * SAMPLES * d).view(runs, components, SAMPLES, d)
        weights = posterior_samples(agent.mu.detach(), agent.L, noise)
        values = values_at(self._q, weights, self._obs, self._action)
        self._inside.append(inside(values, self._truths))
        self._off.append((values.mean(1) - self._truths).mean(-1))

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """At T looks: shares inside (R, T, 2, levels) and mean errors (R, T, 2); truths (R, 2)."""
        return {
            "inside": torch.stack(self._inside, 1).permute(2, 1, 0, 3).numpy(),
            "off": torch.stack(self._off, 1).permute(2, 1, 0).numpy(),
            "truth": self._truths.mean(-1).T.numpy(),
        }
