"""Bootstrapped heads: one learner from each source, and a new one to follow in each episode."""

from __future__ import annotations

import torch
from attrs import field, frozen
from torch import Tensor

from vtbook.neighbours.base import Learner, TDSettings
from vtlib.checks import between, positive, whole
from vtlib.qfunctions import QFunction
from vtlib.replay import Transition
from vtlib.rng import Rng
from vtlib.td import td_cotangent


@frozen(kw_only=True)
class HeadsSettings(TDSettings):
    """Parameters of bootstrapped heads (Osband et al. 2016; with prior functions, 2018).

    heads: K of them, head k starting at source k modulo S. prior_scale: beta of the prior
    functions, 0 for none. alpha: Adam's step size. Raises ValueError for a value outside its range.
    """

    heads: int = field(default=10, validator=whole())
    prior_scale: float = field(default=0.0, validator=between(0, 1e6))
    alpha: float = field(default=1e-3, validator=positive())

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> Heads:
        """An agent that transfers from sources (R, S, d)."""
        return Heads(q, sources.cpu(), obs_dim, self, rng)


class Heads(Learner):
    """K heads Q(s, a; w_k) + beta P_k(s, a), each minimising its own squared TD error (eq. 5.4).

    One head, drawn anew at each first step of an episode, is followed greedily. P_k is a fixed
    function; here it is what two sources that are drawn for the head disagree by,
    Q(s, a; w_i) - Q(s, a; w_j): of the sources' own size, and zero on average; one head in S draws
    the same source twice, and has none. Every head learns
    from every transition (a bootstrap's share p = 1), so only starts and priors tell heads apart.
    ``mu`` (R, K, d) are the weights that learn, without the prior functions. Sources: Osband et al.
    (2016), algorithm 1; Osband, Aslanides and Cassirer (2018), equation 8.
    """

    def __init__(
        self, q: QFunction, sources: Tensor, obs_dim: int, settings: HeadsSettings, rng: Rng
    ) -> None:
        super().__init__(q, sources, obs_dim, settings, rng)
        runs, count, _ = sources.shape
        heads = settings.heads
        self._rows, self._beta = torch.arange(runs), settings.prior_scale
        self.mu = sources[:, torch.arange(heads) % count].clone()
        pairs = rng.stream("prior function").uniform(2 * heads).mul(count).long()
        self._disagree = sources[self._rows.unsqueeze(1), pairs].view(runs, 2, heads, -1)
        self._adam = torch.optim.Adam([self.mu], lr=settings.alpha, fused=True)
        self._choice = rng.stream("component")
        self._head = torch.zeros(runs, dtype=torch.long)

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Greedy actions (R,) of each run's present head, prior function included."""
        x = self._q.prepare(obs.unsqueeze(1))
        self._acting(fresh)
        values = self._q.q(self.mu, x).add(self._prior(x), alpha=self._beta)
        return values[self._rows, self._head, :, 0].argmax(-1)

    def _acting(self, fresh: Tensor) -> Tensor:
        heads = self.mu.shape[1]
        head = self._choice.uniform(1)[:, 0].mul(heads).long().clamp_(max=heads - 1)
        self._head = torch.where(fresh, head, self._head)
        return self.mu[self._rows, self._head].unsqueeze(1)

    def _prior(self, x: Tensor) -> Tensor:
        """Prior functions (R, K, A, B) at prepared observations."""
        first, second = self._disagree.unbind(1)
        return self._q.q(first, x) - self._q.q(second, x)

    def _descend(self, batch: Transition) -> None:
        self.mu.grad = self._gradients(self.mu, batch)
        self._adam.step()

    def _gradients(self, w: Tensor, batch: Transition) -> Tensor:
        if not self._beta:
            return super()._gradients(w, batch)
        s, size = self._td, batch.obs.shape[1]
        x = self._q.prepare(torch.cat([batch.obs, batch.next_obs], 1))
        values, pullback = self._q.vjp(w, x)
        values = values.add(self._prior(x), alpha=self._beta)
        action, reward = batch.action.unsqueeze(1), batch.reward.unsqueeze(1)
        cotangents = td_cotangent(
            values[..., :size],
            values[..., size:],
            action,
            reward,
            batch.terminated.unsqueeze(1),
            s.psi,
            s.gamma,
            s.kappa,
        )
        return pullback(torch.cat(cotangents, -1))
