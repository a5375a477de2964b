"""No learning at all: for each episode Thompson sampling picks a source by what it has earned."""

from __future__ import annotations

from typing import ClassVar

import torch
from attrs import field, frozen
from torch import Tensor

from vtlib.checks import between, check_weights
from vtlib.qfunctions import QFunction, greedy
from vtlib.replay import Transition
from vtlib.rng import Rng


@frozen
class ReusedSettings:
    """The discount of policy reuse (Fernández and Veloso, 2006) by Thompson sampling.

    Raises ValueError for a value outside its range.
    """

    transfers: ClassVar[bool] = True

    gamma: float = field(default=0.99, validator=between(0, 1, below=True))

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> Reused:
        """An agent that plays sources (R, S, d)."""
        return Reused(q, sources, self, rng)


class Reused:
    """An agent of R runs that draws a mean return for each source (R, S, d), and plays the highest.

    Sources are alike beforehand: their means are normal around the mean of all returns so far, with
    the deviation of these returns. ``mu`` (R, 1, d) are the weights that play now. Raises
    ValueError when sources are missing, not finite, not float32 or not of the Q-function's shape.
    """

    def __init__(self, q: QFunction, sources: Tensor, settings: ReusedSettings, rng: Rng):
        check_weights("sources", sources, "run", "source", q.d)
        runs, count, _ = sources.shape
        self._q, self._sources, self._gamma = q, sources, settings.gamma
        self._rows, self._normal = torch.arange(runs), rng.stream("source")
        self._totals, self._episodes = torch.zeros(runs, count), torch.zeros(runs, count)
        self._squares, self._gained = torch.zeros(runs), torch.zeros(runs)
        self._discount, self._begun = torch.ones(runs), torch.zeros(runs, dtype=torch.bool)
        self._arm = torch.zeros(runs, dtype=torch.long)

    @property
    def mu(self) -> Tensor:
        return self._sources[self._rows, self._arm].unsqueeze(1)

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Greedy actions (R,); fresh (R,) marks first steps of episodes, when sources change."""
        ended = (fresh & self._begun).float()
        self._totals[self._rows, self._arm] += ended * self._gained
        self._episodes[self._rows, self._arm] += ended
        self._squares += ended * self._gained.square()
        # drawn at every step: a run's stream must not depend on when its neighbours' episodes end
        drawn = self._draw(self._normal.normal(self._totals.shape[1]))
        self._arm = torch.where(fresh, drawn, self._arm)
        self._gained[fresh], self._discount[fresh] = 0.0, 1.0
        self._begun |= fresh
        return greedy(self._q, self.mu, obs)

    def learn(self, transition: Transition) -> None:
        """Add up the return of an episode."""
        self._gained += self._discount * transition.reward
        self._discount *= self._gamma

    def _draw(self, normal: Tensor) -> Tensor:
        """The source (R,) whose drawn mean return is highest."""
        played = self._episodes.sum(1).clamp(min=1.0)
        centre = self._totals.sum(1) / played
        scale = (self._squares / played - centre.square()).clamp(min=0.0).sqrt()
        scale = torch.where(scale > 0, scale, torch.ones_like(scale)).unsqueeze(1)
        means = (self._totals + centre.unsqueeze(1)) / (self._episodes + 1)
        return (means + scale / (self._episodes + 1).sqrt() * normal).argmax(1)
