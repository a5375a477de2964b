"""Learning without a posterior: mellow TD and double deep Q-learning, from nothing or a source."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import torch
from attrs import field, frozen
from torch import Tensor

from vtlib.checks import HUGE, between, check_weights, kind, one_of, positive, whole
from vtlib.qfunctions import QFunction, greedy
from vtlib.replay import ReplayBuffer, Transition
from vtlib.rng import Rng
from vtlib.td import LEAST_KAPPA, td_gradients


@frozen
class LearnerSettings:
    """Parameters that both baselines share; ValueError for a value outside its range.

    epsilon falls linearly over epsilon_steps iterations. alpha: Adam's step size.
    """

    transfers: ClassVar[bool] = False

    epsilon_steps: int = field(validator=whole())
    epsilon_end: float = field(default=0.02, validator=between(0, 1))
    gamma: float = field(default=0.99, validator=between(0, 1, below=True))
    minibatch: int = field(default=50, validator=whole())
    buffer: int = field(default=50_000, validator=whole())
    alpha: float = field(default=1e-3, validator=positive())
    epsilon_start: float = field(default=1.0, validator=between(0, 1))


@frozen
class MellowTDSettings(LearnerSettings):
    """Parameters of mellow TD (section 5.1.4). Raises ValueError for a value outside its range."""

    psi: float = field(default=0.5, validator=between(0, 1))
    kappa: float = field(default=100.0, validator=between(LEAST_KAPPA, HUGE))

    def agent(self, q: QFunction, w: Tensor, obs_dim: int, rng: Rng) -> MellowTD:
        """A learner that starts from weights w (R, d)."""
        return MellowTD(q, w, obs_dim, self, rng)


@frozen
class DDQNSettings(LearnerSettings):
    """Parameters of DDQN (appendix A.2). Raises ValueError for a value outside its range."""

    #: Iterations from one copy of the weights, which are the target, to the next.
    target_every: int = field(default=500, validator=whole())

    def agent(self, q: QFunction, w: Tensor, obs_dim: int, rng: Rng) -> DDQN:
        """A learner that starts from weights w (R, d)."""
        return DDQN(q, w, obs_dim, self, rng)


@frozen
class FineTuning:
    """A learner that starts from "one" source, the first, or their "mean"; else ValueError."""

    transfers: ClassVar[bool] = True

    learner: MellowTDSettings | DDQNSettings = field(
        factory=lambda: MellowTDSettings(epsilon_steps=1, epsilon_start=0.02, minibatch=200),
        validator=kind(MellowTDSettings | DDQNSettings),
    )
    start: str = field(default="one", validator=one_of(("one", "mean")))

    def first_weights(self, sources: Tensor) -> Tensor:
        """The weights (R, d) to start from, of sources (R, S, d)."""
        return sources[:, 0] if self.start == "one" else sources.mean(1)

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> EpsilonGreedyLearner:
        """A learner that transfers from sources (R, S, d)."""
        return self.learner.agent(q, self.first_weights(sources.cpu()), obs_dim, rng)


class EpsilonGreedyLearner(ABC):
    """Epsilon-greedy learning from a replay buffer by Adam, for R runs in lock-step.

    w: (R, d) initial weights, copied. rng gives the streams "exploration" (epsilon-greedy actions)
    and "replay" (minibatches). ``mu`` (R, 1, d) are the current weights. Raises ValueError when
    weights are not finite, float32 or of another shape.
    """

    def __init__(
        self, q: QFunction, w: Tensor, obs_dim: int, settings: LearnerSettings, rng: Rng
    ) -> None:
        check_weights("weights", w, "run", q.d)
        self._q, self._settings = q, settings
        self._exploration, self._replay = rng.stream("exploration"), rng.stream("replay")
        self.mu = w.detach().unsqueeze(1).clone()
        self._adam = torch.optim.Adam([self.mu], lr=settings.alpha, fused=True)
        self._buffer = ReplayBuffer(len(w), settings.buffer, obs_dim)
        self._steps = 0

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Epsilon-greedy actions (R,)."""
        s = self._settings
        progress = min(1.0, self._steps / s.epsilon_steps)
        epsilon = s.epsilon_start + progress * (s.epsilon_end - s.epsilon_start)
        explore, choice = self._exploration.uniform(2).unbind(-1)
        random = (choice * self._q.n_actions).long().clamp_(max=self._q.n_actions - 1)
        return torch.where(explore < epsilon, random, greedy(self._q, self.mu, obs))

    def learn(self, transition: Transition) -> None:
        """Store one transition of each run and take one gradient step."""
        self._buffer.add(transition)
        self._steps += 1
        self.update()

    def keep(self, rows: Sequence[int]) -> None:
        """Go on with some of the runs, by their places in the batch, in that order."""
        for part in (self._exploration, self._replay, self._buffer):
            part.keep(rows)
        state = self._adam.state[self.mu]
        self.mu = self.mu.detach()[rows]
        self._adam = torch.optim.Adam([self.mu], lr=self._settings.alpha, fused=True)
        # Adam's moments are as large as the weights, its step count is one number
        self._adam.state[self.mu] = {k: x[rows] if x.ndim else x for k, x in state.items()}

    def update(self) -> None:
        """One gradient step on a minibatch of what is remembered."""
        batch = self._buffer.sample(self._replay.uniform(self._settings.minibatch))
        self.mu.grad = self._gradient(batch)
        self._adam.step()

    @abstractmethod
    def _gradient(self, batch: Transition) -> Tensor:
        """Gradient (R, 1, d) of the loss of a minibatch (R, B)."""


class MellowTD(EpsilonGreedyLearner):
    """Direct minimisation of the squared mellow TD error (eq. 5.4)."""

    _settings: MellowTDSettings

    def _gradient(self, batch: Transition) -> Tensor:
        s = self._settings
        return td_gradients(self._q, self.mu, batch, s.psi, s.gamma, s.kappa)


class DDQN(EpsilonGreedyLearner):
    """Double deep Q-learning: the online weights choose the next action, a copy values it.

    The loss is Huber's, quadratic up to an error of 1. Source: van Hasselt, Guez and Silver (2016).
    """

    _settings: DDQNSettings

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._target = self.mu.clone()

    def learn(self, transition: Transition) -> None:
        super().learn(transition)
        if self._steps % self._settings.target_every == 0:
            self._target = self.mu.detach().clone()

    def keep(self, rows: Sequence[int]) -> None:
        super().keep(rows)
        self._target = self._target[rows]

    def _gradient(self, batch: Transition) -> Tensor:
        q = self._q
        following = q.prepare(batch.next_obs)
        best = q.q(self.mu, following).argmax(-2, keepdim=True)
        value = q.q(self._target, following).gather(-2, best).squeeze(-2)
        alive = self._settings.gamma * ~batch.terminated.unsqueeze(1)
        values, pullback = q.vjp(self.mu, q.prepare(batch.obs))
        action = batch.action[:, None, None]
        error = batch.reward.unsqueeze(1) + alive * value - values.gather(-2, action).squeeze(-2)
        slope = error.clamp_(-1, 1).div_(-batch.obs.shape[1]).unsqueeze(-2)
        return pullback(torch.zeros_like(values).scatter_(-2, action, slope))
