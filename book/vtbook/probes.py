"""What is looked at while posteriors learn: how often they cover the truth in rooms."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from vtbook.credible_intervals import inside, posterior_samples, values_at
from vtlab.envs.base import TaskBatch
from vtlab.envs.rooms.plan import plan_rooms
from vtlab.envs.rooms.tasks import SIDE, Rooms
from vtlab.experiment import Experiment
from vtlib.rng import Rng, Stream
from vtlib.training import Agent
from vtlib.transfer import VariationalTransfer

SAMPLES = 400  # of each component's posterior


class Probe(ABC):
    """Looks at an agent now and then; ``arrays`` are stored with the returns."""

    def __init__(
        self, experiment: Experiment, label: str, runs: Sequence[int], tasks: TaskBatch
    ) -> None:
        rng = Rng(experiment.stream, runs)
        self._experiment, self._q = experiment, experiment.family.q()
        self._settings: Any = experiment.algorithms[label]
        self._count, self._places = experiment.probes, rng.stream("probes")
        self._noise = rng.stream("probe samples")
        self._noted: list[dict[str, Tensor]] = []

    def look(self, agent: Agent) -> None:
        """Note what the agent is like now."""
        self._noted.append(self._note(agent))

    @abstractmethod
    def _note(self, agent: Any) -> dict[str, Tensor]:
        """What is to be stored of the agent now."""

    def _samples(self, agent: VariationalTransfer, count: int) -> Tensor:
        """So many weights from each component of the present posterior."""
        runs, components, d = agent.mu.shape
        noise = self._noise.normal(components * count * d).view(runs, components, count, d)
        return posterior_samples(agent.mu.detach().cpu(), agent.scale_tril.cpu(), noise)

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """What was noted at T looks, (R, T) or (R, T, ...)."""
        names = self._noted[0]
        return {name: torch.stack([x[name] for x in self._noted], 1).numpy() for name in names}


def random_pairs(places: Stream, count: int) -> tuple[Tensor, Tensor]:
    """So many states (R, count, 2) in the rooms and actions (R, count), both uniform."""
    u = places.uniform(3 * count).view(-1, count, 3)
    return SIDE * u[..., :2], (u[..., 2] * Rooms.n_actions).long()


class CoverageProbe(Probe):
    """Random pairs of state and action of each run's task, looked at while the runs learn.

    States are uniform in the square, actions uniform. There are two truths: the planned optimal
    value, and the one planned with mellowmax, which is what the algorithms' TD errors ask for.
    Noted are the shares inside (R, T, 2, levels) and mean errors (R, T, 2), beside truths (R, 2).
    """

    def __init__(
        self, experiment: Experiment, label: str, runs: Sequence[int], tasks: TaskBatch
    ) -> None:
        super().__init__(experiment, label, runs, tasks)
        assert isinstance(tasks, Rooms), "only rooms are planned for every state"
        self._obs, self._action = random_pairs(self._places, self._count)
        kappas = None, self._settings.kappa
        rows = torch.arange(self._count)
        truths = [
            # endless: a transition that the horizon cuts off is bootstrapped like any other
            plan_rooms(tasks, i, None, kappa).q(self._obs[i])[rows, self._action[i]]
            for kappa in kappas
            for i in range(len(runs))
        ]
        self._truths = torch.stack(truths).view(len(kappas), len(runs), -1)

    def _note(self, agent: VariationalTransfer) -> dict[str, Tensor]:
        values = values_at(self._q, self._samples(agent, SAMPLES), self._obs, self._action)
        shares, off = inside(values, self._truths), (values.mean(1) - self._truths).mean(-1)
        return {"inside": shares.transpose(0, 1), "off": off.T}

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """What was noted, and the mean truths."""
        return {**super().arrays, "truth": self._truths.mean(-1).T.numpy()}
