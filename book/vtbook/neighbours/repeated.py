"""Any learner with several gradient steps for each step of the environment."""

from __future__ import annotations

from typing import Any

from attrs import field, frozen
from torch import Tensor

from vtlab.experiment import Algorithm
from vtlib.checks import kind, whole
from vtlib.qfunctions import QFunction
from vtlib.replay import Transition
from vtlib.rng import Rng
from vtlib.transfer import Settings


@frozen
class RepeatedSettings:
    """Parameters of an algorithm that learns ``updates`` times a step.

    Raises ValueError for a value outside its range.
    """

    settings: Any = field(default=Settings(), validator=kind(Algorithm))
    updates: int = field(default=4, validator=whole())

    @property
    def transfers(self) -> bool:
        """Whether the algorithm transfers."""
        return bool(self.settings.transfers)

    @property
    def repeated(self) -> tuple[Any, int]:
        """The algorithm and the number of its updates, for kernels that take them at once."""
        return self.settings, self.updates

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> Repeated:
        """The algorithm's agent, from sources (R, S, d) or first weights (R, d)."""
        return Repeated(self.settings.agent(q, sources, obs_dim, rng), self.updates)


class Repeated:
    """An agent with so many gradient steps, each on a minibatch of its own, for each step."""

    def __init__(self, agent: Any, updates: int) -> None:
        self._agent, self._updates = agent, updates

    @property
    def mu(self) -> Tensor:
        """The agent's weights (R, C, d)."""
        mu: Tensor = self._agent.mu
        return mu

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """The agent's actions (R,)."""
        actions: Tensor = self._agent.act(obs, fresh)
        return actions

    def learn(self, transition: Transition) -> None:
        """Store one transition of each run and take the gradient steps."""
        self._agent.learn(transition)
        for _ in range(self._updates - 1):
            self._agent.update()
