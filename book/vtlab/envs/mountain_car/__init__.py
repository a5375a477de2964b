"""Mountain car: what it brings to the experiments."""

import numpy as np
import torch
from attrs import evolve, field, frozen
from torch import Tensor

from vtlab.envs.base import TaskFamily
from vtlab.envs.mountain_car.plan import mean_return
from vtlab.envs.mountain_car.tasks import MountainCar
from vtlib.checks import between
from vtlib.qfunctions import MLP

__all__ = ["MountainCar", "MountainCarFamily"]


@frozen
class MountainCarFamily(TaskFamily):
    """Mountain car tasks with a speed uniform in [0.001, 0.0015] (thesis section 6.2.2).

    `last_reward` is that of the step to the goal. Raises ValueError when it is not in [-1, 0].
    """

    last_reward: float = field(default=0.0, validator=between(-1, 0))

    parameters = MountainCar.parameters
    limits = (-90.0, -35.0)
    kernel = "mountain_car"

    def q(self) -> MLP:
        """A network with one hidden layer of 64 units: 387 weights."""
        return MLP((2, 64, 3))

    def optimum(self, tasks: MountainCar) -> Tensor:
        """What the planned policy earns (R,), from the episodes' own starts."""
        return torch.stack([mean_return(tasks, index) for index in range(len(tasks))])

    def sample(self, rng: np.random.Generator, count: int) -> MountainCar:
        tasks = MountainCar.of(count, speed=rng.uniform(0.001, 0.0015, count))
        return evolve(tasks, last_reward=self.last_reward)

    def kernel_parameters(self, tasks: MountainCar, row: int) -> list[float]:
        """The speed, and the reward of the step to the goal."""
        return [float(tasks.speed[row]), tasks.last_reward]
