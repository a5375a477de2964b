"""What is looked at while posteriors learn: their coverage in rooms, their stability elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from vtlib.coverage import inside, posterior_samples, values_at
from vtlib.domains import domain
from vtlib.envs.episodes import Tasks
from vtlib.envs.rooms import SIDE, Rooms
from vtlib.experiments.experiment import Experiment
from vtlib.mellow import mellowmax
from vtlib.planning import plan
from vtlib.qfunctions import QFunction
from vtlib.stability import largest_step, steepest
from vtlib.streams import Stream
from vtlib.training import Agent
from vtlib.transfer import Settings, VariationalTransfer

SAMPLES = 400  # of each component's posterior
FEWER = 50  # the same where only a standard deviation is asked for


class Probe(Protocol):
    """Looks at an agent now and then; ``arrays`` are stored with the returns."""

    def look(self, agent: Agent) -> None:
        """Note what the agent is like now."""

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """What was noted, a row for each run."""


def probe_of(
    experiment: Experiment, runs: Sequence[int], tasks: Tasks, settings: Settings
) -> Probe:
    """The probe of an experiment's runs: coverage needs planned values, which the rooms have."""
    if isinstance(tasks, Rooms):
        return CoverageProbe(experiment, runs, tasks, settings.kappa)
    return StabilityProbe(experiment, runs, settings)


class CoverageProbe:
    """Random pairs of state and action of each run's task, looked at while the runs learn.

    States are uniform in the square, actions uniform. There are two truths: the planned optimal
    value, and the one planned with mellowmax, which is what the algorithms' TD errors ask for.
    """

    def __init__(
        self, experiment: Experiment, runs: Sequence[int], tasks: Rooms, kappa: float
    ) -> None:
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
        weights = posterior_samples(agent.mu.detach().cpu(), agent.L.cpu(), noise)
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


def value_and_spread(
    q: QFunction, agent: VariationalTransfer, obs: Tensor, noise: Stream, kappa: float
) -> tuple[Tensor, Tensor]:
    """Mellow value of the posterior's mean, and the standard deviation of its samples' values.

    (R,) each, averaged over states obs (R, B, obs_dim), the deviation also over actions.
    """
    mu, L = agent.mu.detach().cpu(), agent.L.cpu()
    runs, components, d = mu.shape
    draws = noise.normal(components * FEWER * d).view(runs, components, FEWER, d)
    x = q.prepare(obs)
    spread = q.q(posterior_samples(mu, L, draws), x).std(1).mean((1, 2))
    return mellowmax(q.q(mu, x), kappa, 2).mean((1, 2)), spread


class StabilityProbe:
    """Values, spread and steps of posteriors at remembered transitions, as the runs learn."""

    def __init__(self, experiment: Experiment, runs: Sequence[int], settings: Settings) -> None:
        self._q, self._settings = domain(experiment.family).q(), settings
        self._count = experiment.probes
        self._remembered = Stream(experiment.stream, runs, "probes")
        self._noise = Stream(experiment.stream, runs, "probe samples")
        self._noted: list[tuple[Tensor, Tensor, Tensor]] = []

    def look(self, agent: Agent) -> None:
        """Note the value of the mean, the values' spread, and the step on L against its bound."""
        assert isinstance(agent, VariationalTransfer)
        s, mu = self._settings, agent.mu.detach().cpu()
        batch = agent.remembered(self._remembered.uniform(self._count))
        value, spread = value_and_spread(self._q, agent, batch.obs, self._noise, s.kappa)
        steps = []
        for c in range(mu.shape[1]):
            eta, length = steepest(self._q, mu[:, c], batch, s.psi, s.gamma, s.kappa)
            steps.append(s.alpha_L * eta / largest_step(length, s.weights))
        step = torch.stack(steps).amax(0)
        self._noted.append((value, spread, step.float()))

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """At T looks (R, T): values, spreads of values, steps over the largest stable step."""
        noted = (torch.stack(x, 1).numpy() for x in zip(*self._noted, strict=True))
        return dict(zip(("value", "spread", "step"), noted, strict=True))
