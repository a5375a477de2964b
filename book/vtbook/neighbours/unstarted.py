"""Variational transfer without its start: the prior is the sources', the first means are random."""

from __future__ import annotations

import torch
from attrs import field, frozen
from torch import Tensor

from vtlib.checks import HUGE, between, check_weights, one_of
from vtlib.priors import MixturePrior, Start
from vtlib.qfunctions import QFunction
from vtlib.rng import Rng
from vtlib.transfer import Settings, VariationalTransfer


@frozen
class UnstartedSettings(Settings):
    """MGVT whose components start at random weights of some standard deviation, scale.

    Other parameters are those of MGVT. Raises ValueError for a value outside its range.
    """

    family: str = field(default="mixture", validator=one_of(("mixture",)))
    scale: float = field(default=0.1, validator=between(0, HUGE))

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> VariationalTransfer:
        """An agent that starts from weights of the stream "first weights", not from sources."""
        check_weights("sources", sources, "run", "source", q.d)
        first = rng.stream("first weights").normal(self.components * q.d)
        first = self.scale * first.view(-1, self.components, q.d)
        both = torch.cat([first.to(sources.device), sources], 1)
        return VariationalTransfer(q, both, obs_dim, self, rng)

    def prior(self, sources: Tensor) -> UnstartedPrior:
        """The prior learned from sources (R, S, d), which come after as many first weights as C."""
        first, own = sources.tensor_split([self.components], 1)
        return UnstartedPrior(first, own, self.sigma_p2, self.responsibilities)


class UnstartedPrior(MixturePrior):
    """The prior of MGVT, for a posterior whose means start at first (R, C, d)."""

    def __init__(
        self, first: Tensor, sources: Tensor, variance: float, responsibilities: str
    ) -> None:
        super().__init__(sources, variance, responsibilities)
        self._first = first

    def start(self, components: int, init: str) -> Start:
        """The first weights, with the variance of the prior's components."""
        return Start(self._first.clone(), self._variance)
