"""Cartpole: what it brings to the experiments."""

import numpy as np
import torch
from attrs import frozen
from torch import Tensor

from vtlab.envs.base import TaskFamily
from vtlab.envs.cartpole.tasks import Cartpole
from vtlib.qfunctions import MLP

__all__ = ["Cartpole", "CartpoleFamily"]

WHOLE_EPISODE = (1 - Cartpole.gamma**Cartpole.horizon) / (1 - Cartpole.gamma)


@frozen
class CartpoleFamily(TaskFamily):
    """Cartpole tasks with masses and half length uniform in the ranges of thesis section 6.2.1."""

    parameters = Cartpole.parameters
    limits = (0.0, 68.0)
    kernel = "cartpole"

    def q(self) -> MLP:
        """A network with one hidden layer of 32 units: 226 weights."""
        return MLP((4, 32, 2))

    def optimum(self, tasks: Cartpole) -> Tensor:
        """The discounted return (R,) of an episode that lasts to the horizon."""
        return torch.full((len(tasks),), WHOLE_EPISODE)

    def solved(self, returns: Tensor, optimum: Tensor, required: float) -> Tensor:
        """Whether the required share of episodes (R, E) lasts to the horizon, bool (R,)."""
        whole = returns >= optimum.unsqueeze(1) - 1e-3
        return whole.float().mean(1) >= required

    def sample(self, rng: np.random.Generator, count: int) -> Cartpole:
        return Cartpole.of(
            count,
            cart_mass=rng.uniform(0.5, 1.5, count),
            pole_mass=rng.uniform(0.1, 0.3, count),
            half_length=rng.uniform(0.2, 1.0, count),
        )
