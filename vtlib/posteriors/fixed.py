"""Posteriors of which only the means are learned: the deviations stay those of the prior."""

from torch import Tensor

from vtlib.posteriors.diagonal import Diagonal


class Fixed(Diagonal):
    """Gaussians w = mu + sigma z whose deviations sigma are the prior's for ever, as `Diagonal`."""

    def step(self, gradients: Tensor, kl_weight: float) -> None:
        """Leave the deviations as they are."""
