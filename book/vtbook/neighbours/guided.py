"""Exploration apart from weights: sources act in the first episodes, and only then the learner."""

from __future__ import annotations

from typing import ClassVar

import torch
from attrs import field, frozen
from torch import Tensor

from vtlib.baselines import EpsilonGreedyLearner, MellowTDSettings
from vtlib.checks import HUGE, between, check_weights, kind, whole
from vtlib.qfunctions import QFunction, greedy
from vtlib.replay import Transition
from vtlib.rng import Rng


@frozen
class GuidedSettings:
    """Parameters of a learner from nothing that sees what its sources do.

    learner: learns from the first step on, from random weights of standard deviation scale.
    episodes: in so many of the first the sources act greedily, in turn. Raises ValueError for a
    value outside its range.
    """

    transfers: ClassVar[bool] = True

    learner: MellowTDSettings = field(
        default=MellowTDSettings(epsilon_steps=2_000), validator=kind(MellowTDSettings)
    )
    episodes: int = field(default=10, validator=whole())
    scale: float = field(default=0.1, validator=between(0, HUGE))

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> Guided:
        """An agent that follows sources (R, S, d), whose weights it never takes."""
        check_weights("sources", sources, "run", "source", q.d)
        w = self.scale * rng.stream("first weights").normal(q.d)
        learner = self.learner.agent(q, w, obs_dim, rng)
        return Guided(q, sources, learner, self.episodes)


class Guided:
    """An agent of R runs that learns from what sources (R, S, d) do first, then acts itself."""

    def __init__(
        self, q: QFunction, sources: Tensor, learner: EpsilonGreedyLearner, episodes: int
    ) -> None:
        self._q, self._sources, self._learner, self._episodes = q, sources, learner, episodes
        self._runs, self._episode = torch.arange(len(sources)), torch.full((len(sources),), -1)

    @property
    def mu(self) -> Tensor:
        """The learner's weights (R, 1, d)."""
        return self._learner.mu

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Actions (R,) of sources or of the learner; fresh (R,) marks first steps of episodes."""
        self._episode += fresh
        source = self._sources[self._runs, self._episode % self._sources.shape[1]]
        shown = greedy(self._q, source.unsqueeze(1), obs)
        own = self._learner.act(obs, fresh)
        return torch.where(self._episode < self._episodes, shown, own)

    def learn(self, transition: Transition) -> None:
        """Let the learner take in one transition of each run."""
        self._learner.learn(transition)
