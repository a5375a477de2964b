"""A prior for tasks that drift: the newer a source, the larger its weight in the mixture."""

from __future__ import annotations

import torch
from attrs import field, frozen
from torch import Tensor

from vtlib.checks import one_of, positive, whole
from vtlib.priors import MixturePrior, Start
from vtlib.transfer import Settings


@frozen
class DriftingSettings(Settings):
    """Variational transfer with one component, from sources in the order in which they were solved.

    bandwidth: rho of the kernel, in tasks. Other parameters are those of 1-MGVT. Raises ValueError
    for a value outside its range.
    """

    bandwidth: float = field(default=2.0, validator=positive())
    family: str = field(default="mixture", validator=one_of(("mixture",)))
    components: int = field(default=1, validator=whole(1, 1))

    def prior(self, sources: Tensor) -> DriftingPrior:
        """The prior learned from sources (R, S, d), the newest last."""
        return DriftingPrior(sources, self.sigma_p2, self.bandwidth, self.responsibilities)


class DriftingPrior(MixturePrior):
    """N(w_j, variance * I) around sources w_j, weighted by exp(-(S + 1 - j)^2 / (2 bandwidth^2)).

    The target is task S + 1. A posterior starts at the "mean", with these weights, or at the newest
    of the "sources". Source: Canonaco et al. (2021), their temporal kernel, here a Gaussian one.
    """

    def __init__(
        self, sources: Tensor, variance: float, bandwidth: float, responsibilities: str = "exact"
    ) -> None:
        super().__init__(sources, variance, responsibilities)
        age = torch.arange(sources.shape[1], 0, -1, device=sources.device)
        self.log_weights = torch.log_softmax(-(age**2) / (2 * bandwidth**2), 0)
        self._mean = (self.log_weights.exp().unsqueeze(-1) * sources).sum(1, keepdim=True)

    def start(self, components: int, init: str) -> Start:
        """The newest of the "sources", or their weighted "mean"."""
        mu = self._sources[:, -1:] if init == "sources" else self._mean
        return Start(mu.clone(), self._variance)

    def pull(self, mu: Tensor) -> Tensor:
        """Gradient (R, 1, d) of the tightened bound with respect to the means (R, 1, d)."""
        if self._equal:
            return (mu - self._mean) / self._variance
        apart = mu - self._sources
        near = self.log_weights - (apart * apart).sum(-1) / (2 * self._variance)
        theta = torch.softmax(near.double(), -1).to(mu.dtype).unsqueeze(1)
        return theta @ apart / self._variance
