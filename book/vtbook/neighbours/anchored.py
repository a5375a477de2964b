"""One weight vector that is pulled back to the sources' mean, everywhere or in some places."""

from __future__ import annotations

import torch
from attrs import field, frozen
from torch import Tensor

from vtbook.neighbours.base import Learner, TDSettings
from vtlib.checks import HUGE, between, kind, one_of, positive
from vtlib.qfunctions import QFunction
from vtlib.replay import Transition
from vtlib.rng import Rng


@frozen(kw_only=True)
class AnchoredSettings(TDSettings):
    """Parameters of a pulled vector. Raises ValueError for a value outside its range.

    strength: the pull on a weight is this times its distance from the mean, divided by the step; it
    is lambda / sigma_p^2 of a mixture. pull: which weights are pulled. A weight is seen once the
    slopes of the values of all actions taken, with respect to it, add up to ``enough``; for a
    linear Q-function they are its features. held: weights do not move before they are seen. alpha:
    step size of Adam. epsilon: what Adam adds to the root of the mean squared gradient, so that
    much smaller gradients hardly move a weight.
    """

    strength: float = field(default=0.1, validator=between(0, HUGE))
    pull: str = field(default="everywhere", validator=one_of(("everywhere", "seen", "unseen")))
    enough: float = field(default=1.0, validator=positive())
    held: bool = field(default=False, validator=kind(bool))
    alpha: float = field(default=1e-3, validator=positive())
    epsilon: float = field(default=1e-8, validator=positive())

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> Anchored:
        """An agent that transfers from sources (R, S, d)."""
        return Anchored(q, sources.cpu(), obs_dim, self, rng)


class Anchored(Learner):
    """It starts at the mean, acts greedily and learns by Adam, without samples (eqs. 5.2, 5.4)."""

    def __init__(
        self, q: QFunction, sources: Tensor, obs_dim: int, settings: AnchoredSettings, rng: Rng
    ) -> None:
        super().__init__(q, sources, obs_dim, settings, rng)
        self._settings, self._mean = settings, sources.mean(1, keepdim=True)
        self.mu = self._mean.clone()
        self._slopes = torch.zeros_like(self.mu)
        rate, epsilon = settings.alpha, settings.epsilon
        self._adam = torch.optim.Adam([self.mu], lr=rate, eps=epsilon, fused=True)

    @property
    def seen(self) -> Tensor:
        """Which weights (R, 1, d) have been seen."""
        return self._slopes >= self._settings.enough

    @property
    def moved(self) -> Tensor:
        """How far each weight (R, 1, d) is from the mean, where it began."""
        return (self.mu - self._mean).detach().abs()

    def learn(self, transition: Transition) -> None:
        """Store one transition of each run, note which weights it has seen, and learn."""
        values, pullback = self._q.vjp(self.mu, self._q.prepare(transition.obs.unsqueeze(1)))
        action = transition.action.view(-1, 1, 1, 1)
        self._slopes += pullback(torch.zeros_like(values).scatter_(-2, action, 1.0)).abs()
        super().learn(transition)

    def _acting(self, fresh: Tensor) -> Tensor:
        return self.mu

    def _descend(self, batch: Transition) -> None:
        s, seen = self._settings, self.seen
        pulled = {"everywhere": torch.ones_like(seen), "seen": seen, "unseen": ~seen}[s.pull]
        away = (self.mu - self._mean) * pulled
        self.mu.grad = self._gradients(self.mu, batch).add_(away, alpha=s.strength / self._steps)
        before = self.mu.clone()
        self._adam.step()
        if s.held:
            self.mu.copy_(torch.where(seen, self.mu, before))
