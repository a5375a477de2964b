"""Fine-tuning with several gradient steps for each step of the environment."""

from __future__ import annotations

from typing import Any, ClassVar

from attrs import field, frozen
from torch import Tensor

from vtlib.baselines import FineTuning, MellowTD
from vtlib.checks import kind, whole
from vtlib.qfunctions import QFunction
from vtlib.replay import Transition
from vtlib.rng import Rng


@frozen
class RepeatedTuning:
    """Parameters of fine-tuning by mellow TD that learns ``updates`` times a step.

    Raises ValueError for a value outside its range.
    """

    transfers: ClassVar[bool] = True

    tuning: FineTuning = field(validator=kind(FineTuning))
    updates: int = field(default=4, validator=whole())

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> RepeatedTD:
        """A learner that transfers from sources (R, S, d)."""
        w = self.tuning.first_weights(sources.cpu())
        return RepeatedTD(self.updates, q, w, obs_dim, self.tuning.learner, rng)


class RepeatedTD(MellowTD):
    """``MellowTD`` with so many gradient steps, each on a minibatch of its own, for each step."""

    def __init__(self, updates: int, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._updates = updates

    def learn(self, transition: Transition) -> None:
        """Store one transition of each run and take the gradient steps."""
        super().learn(transition)
        for _ in range(self._updates - 1):
            self._update()
