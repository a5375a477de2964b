"""Trust whose last steps are the trial by which ``transfer`` decides what it keeps."""

from __future__ import annotations

from attrs import field, frozen
from torch import Tensor

from vtlib.checks import whole
from vtlib.qfunctions import QFunction
from vtlib.replay import Transition
from vtlib.rng import Rng
from vtlib.trust import Trust, Trusting


@frozen
class TriedTrust(Trust):
    """Parameters of ``Trust``, and the step after which what was learned is tried.

    Raises ValueError for a value outside its range.
    """

    trial: int = field(default=4_000, kw_only=True, validator=whole())

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> Tried:
        """An agent that transfers from sources (R, S, d)."""
        return Tried(q, sources, obs_dim, self, rng)


class Tried(Trusting):
    """An agent that lets greedy episodes decide from a step on."""

    def __init__(
        self, q: QFunction, sources: Tensor, obs_dim: int, settings: TriedTrust, rng: Rng
    ) -> None:
        super().__init__(q, sources, obs_dim, settings, rng)
        self._trial = settings.trial

    def learn(self, transition: Transition) -> None:
        """Take in one transition of each run, and begin the trial after its step."""
        super().learn(transition)
        if self._steps == self._trial:
            self.judge()
