"""No learning at all: each source plays a few episodes, and the best one plays from then on."""

from __future__ import annotations

from typing import ClassVar

import torch
from attrs import field, frozen
from torch import Tensor

from vtlib.checks import between, check_weights, whole
from vtlib.qfunctions import QFunction, greedy
from vtlib.replay import Transition
from vtlib.rng import Rng


@frozen
class UntouchedSettings:
    """Parameters of choosing among sources: greedy episodes for each, and their discount.

    Raises ValueError for a value outside its range.
    """

    transfers: ClassVar[bool] = True

    trials: int = field(default=1, validator=whole())
    gamma: float = field(default=0.99, validator=between(0, 1, below=True))

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> Untouched:
        """An agent that plays sources (R, S, d)."""
        return Untouched(q, sources, self, rng)


class Untouched:
    """An agent of R runs that tries each of its sources (R, S, d), then keeps to the best one.

    A source is the better the higher the mean discounted return of its trials; of equal ones the
    first counts. ``mu`` (R, 1, d) are the weights that play now. Raises ValueError when sources are
    missing, not finite, not float32 or not of the Q-function's shape.
    """

    def __init__(self, q: QFunction, sources: Tensor, settings: UntouchedSettings, rng: Rng):
        check_weights("sources", sources, "run", "source", q.d)
        runs, count, _ = sources.shape
        self._q, self._sources, self._settings = q, sources, settings
        self._runs, self._trials = torch.arange(runs), settings.trials * count
        self._totals = torch.zeros(runs, count)
        self._episode = torch.full((runs,), -1)
        self._discount = torch.ones(runs)
        self.mu = sources[:, :1]

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Greedy actions (R,); fresh (R,) marks first steps of episodes, when sources change."""
        self._episode += fresh
        self._discount[fresh] = 1.0
        self.mu = self._sources[self._runs, self._playing()].unsqueeze(1)
        return greedy(self._q, self.mu, obs)

    def learn(self, transition: Transition) -> None:
        """Add up the returns of trials."""
        gained = self.trying.float() * self._discount * transition.reward
        self._totals[self._runs, self._playing()] += gained
        self._discount *= self._settings.gamma

    @property
    def trying(self) -> Tensor:
        """Whether a run still tries its sources (R,)."""
        return self._episode < self._trials

    def _playing(self) -> Tensor:
        """The place of the source (R,) that plays."""
        trial = self._episode // self._settings.trials
        return torch.where(self.trying, trial, self._totals.argmax(1))
