"""Q-functions that are linear in radial bases of two coordinates, as the rooms have them."""

from collections.abc import Callable

import torch
from torch import Tensor

from vtlib.qfunctions import check_observations

# Features below float32's rounding of their sum are set to zero. They and their products would
# become denormal numbers, on which a processor is many times slower.
ROUNDING = 1e-7
FAR = -30.0


class RBFLinear:
    """Linear in Gaussian radial bases on a square grid, normalised to sum to one, no bias.

    centers: (m,) coordinates of the grid on either axis of a two-dimensional observation;
    variance of each basis in squared units of the observation. d = n_actions * m * m weights,
    one block of m * m per action. The rooms use m = 11 integer centres and variance 1/9.
    """

    def __init__(self, centers: Tensor, variance: float, n_actions: int) -> None:
        self.n_actions = self.width = n_actions
        self.d = n_actions * len(centers) ** 2
        self._centers = centers
        self._rate = 0.5 / variance

    def prepare(self, obs: Tensor) -> Tensor:
        """Features (R, m * m, B), one column per observation of (R, B, 2)."""
        # the Gaussian and its normaliser are products of one factor for each axis
        check_observations(obs, 2)
        columns = obs.transpose(-1, -2).contiguous()
        distance = columns.unsqueeze(-2) - self._centers.to(obs.device).unsqueeze(-1)
        axes = distance.square_().mul_(-self._rate)
        axes = axes.sub_(axes.amax(-2, keepdim=True)).clamp_(min=FAR).exp_()
        axes = axes.div_(axes.sum(-2, keepdim=True))
        axes = torch.threshold_(axes, ROUNDING, 0.0)
        return (axes[:, 0].unsqueeze(2) * axes[:, 1].unsqueeze(1)).flatten(1, 2)

    def q(self, w: Tensor, x: Tensor) -> Tensor:
        """Values (R, K, A, B) of weights (R, K, d) at features (R, m * m, B)."""
        runs, k, _ = w.shape
        rows = w.reshape(runs, k * self.n_actions, -1)
        return torch.bmm(rows, x).view(runs, k, self.n_actions, -1)

    def vjp(self, w: Tensor, x: Tensor) -> tuple[Tensor, Callable[[Tensor], Tensor]]:
        """Values, and the map from a cotangent (R, K, A, B) to a gradient (R, K, d)."""

        def pullback(cotangent: Tensor) -> Tensor:
            return torch.bmm(cotangent.flatten(1, 2), x.transpose(1, 2)).view(w.shape)

        return self.q(w, x), pullback
