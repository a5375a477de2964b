"""Trust with one of its settings changed, or with sources that promise too much."""

from __future__ import annotations

from attrs import field, frozen
from torch import Tensor

from vtlib.checks import HUGE, between, kind
from vtlib.qfunctions import QFunction
from vtlib.rng import Rng
from vtlib.transfer import Settings
from vtlib.trust import RANDOM, Trust, Trusting


@frozen
class VariedTrust(Trust):
    """Parameters of ``Trust`` whose posterior learns with ``learner``, in units of the sources.

    random: the share of random actions while what was learned is lost. optimism: what is added to
    all values of the sources' networks. Raises ValueError for a value outside its range.
    """

    learner: Settings = field(kw_only=True, validator=kind(Settings), default=Trust().in_units)
    random: float = field(default=RANDOM, kw_only=True, validator=between(0, 1))
    optimism: float = field(default=0.0, kw_only=True, validator=between(0, HUGE))

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> Trusting:
        """An agent that transfers from sources (R, S, d)."""
        if self.optimism:  # the last weights of a network are the biases of its outputs
            sources = sources.clone()
            sources[..., -q.n_actions :] += self.optimism
        agent = super().agent(q, sources, obs_dim, rng)
        agent.random = self.random
        return agent

    @property
    def in_units(self) -> Settings:
        """The parameters of the posterior that learns."""
        return self.learner
