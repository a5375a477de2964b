"""The best of the sources, found by a few episodes of each, and fine-tuned from then on."""

from __future__ import annotations

from typing import Any, ClassVar

import torch
from attrs import field, frozen
from torch import Tensor

from vtbook.neighbours.untouched import Untouched, UntouchedSettings
from vtlib.baselines import DDQN, DDQNSettings, EpsilonGreedyLearner, MellowTDSettings
from vtlib.checks import kind, whole
from vtlib.qfunctions import QFunction
from vtlib.replay import Transition
from vtlib.rng import Rng


@frozen
class PickedSettings:
    """Parameters of fine-tuning the best source: the learner, and greedy episodes of each source.

    Raises ValueError for a value outside its range.
    """

    transfers: ClassVar[bool] = True

    learner: MellowTDSettings | DDQNSettings = field(
        default=DDQNSettings(epsilon_steps=1, epsilon_start=0.02),
        validator=kind(MellowTDSettings | DDQNSettings),
    )
    trials: int = field(default=1, validator=whole())

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> Picked:
        """An agent that tries sources (R, S, d) and fine-tunes one."""
        trying = UntouchedSettings(self.trials, self.learner.gamma).agent(q, sources, obs_dim, rng)
        return Picked(trying, self.learner.agent(q, sources[:, 0], obs_dim, rng))


class Picked:
    """An agent of R runs in each of which the best source plays on, and learns from all steps.

    ``mu`` (R, 1, d) are the weights that play now. While sources are tried the learner remembers
    what they do; its weights are those of the best source once the last trial has ended.
    """

    def __init__(self, trying: Untouched, learner: EpsilonGreedyLearner) -> None:
        self._trying, self._learner = trying, learner
        self._begun = torch.zeros(len(trying.mu), dtype=torch.bool)

    @property
    def mu(self) -> Tensor:
        """Weights (R, 1, d) of the source on trial, or of the learner."""
        return torch.where(self._begun.view(-1, 1, 1), self._learner.mu.detach(), self._trying.mu)

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Actions (R,) of sources or of the learner; fresh (R,) marks first steps of episodes."""
        shown = self._trying.act(obs, fresh)
        ended = ~self._begun & ~self._trying.trying
        if ended.any():
            self._begin(ended)
        return torch.where(self._begun, self._learner.act(obs, fresh), shown)

    def learn(self, transition: Transition) -> None:
        """Add up the returns of trials, and let the learner take in one transition of each run."""
        self._trying.learn(transition)
        self._learner.learn(transition)

    def update(self) -> None:
        """One more gradient step."""
        self._learner.update()

    def _begin(self, rows: Tensor) -> None:
        """Put the best sources in the learner's place, with moments of the gradient of zero."""
        learner: Any = self._learner
        with torch.no_grad():
            learner.mu[rows] = self._trying.mu[rows]
        for moment in learner._adam.state[learner.mu].values():
            if moment.ndim:
                moment[rows] = 0.0
        if isinstance(learner, DDQN):
            learner._target[rows] = self._trying.mu[rows]
        self._begun |= rows
