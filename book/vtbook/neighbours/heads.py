"""Bootstrapped heads: one learner from each source, and a new one to follow in each episode."""

from __future__ import annotations

import torch
from attrs import field, frozen
from torch import Tensor

from vtbook.neighbours.base import Learner, TDSettings
from vtlib.checks import positive, whole
from vtlib.qfunctions import QFunction
from vtlib.replay import Transition
from vtlib.rng import Rng


@frozen(kw_only=True)
class HeadsSettings(TDSettings):
    """Parameters of bootstrapped heads (Osband et al. 2016).

    heads: K of them, head k starting at source k modulo S. alpha: Adam's step size. Raises
    ValueError for a value outside its range.
    """

    heads: int = field(default=10, validator=whole())
    alpha: float = field(default=1e-3, validator=positive())

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> Heads:
        """An agent that transfers from sources (R, S, d)."""
        return Heads(q, sources.cpu(), obs_dim, self, rng)


class Heads(Learner):
    """K heads Q(s, a; w_k), each minimising its own squared TD error (eq. 5.4).

    One head, drawn anew at each first step of an episode, is followed greedily. Every head learns
    from every transition (a bootstrap's share p = 1), so only their starts tell heads apart. ``mu``
    (R, K, d) are their weights. Source: Osband et al. (2016), algorithm 1.
    """

    def __init__(
        self, q: QFunction, sources: Tensor, obs_dim: int, settings: HeadsSettings, rng: Rng
    ) -> None:
        super().__init__(q, sources, obs_dim, settings, rng)
        runs, count, _ = sources.shape
        heads = settings.heads
        self._rows = torch.arange(runs)
        self.mu = sources[:, torch.arange(heads) % count].clone()
        self._adam = torch.optim.Adam([self.mu], lr=settings.alpha, fused=True)
        self._choice = rng.stream("component")
        self._head = torch.zeros(runs, dtype=torch.long)

    def _acting(self, fresh: Tensor) -> Tensor:
        heads = self.mu.shape[1]
        head = self._choice.uniform(1)[:, 0].mul(heads).long().clamp_(max=heads - 1)
        self._head = torch.where(fresh, head, self._head)
        return self.mu[self._rows, self._head].unsqueeze(1)

    def _descend(self, batch: Transition) -> None:
        self.mu.grad = self._gradients(self.mu, batch)
        self._adam.step()
