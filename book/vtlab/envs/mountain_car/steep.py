"""Mountain cars on hills that pull harder or less than those where the sources learned."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import torch
from attrs import evolve, field, frozen
from torch import Tensor

from vtlab.envs.mountain_car import MountainCarFamily
from vtlab.envs.mountain_car.tasks import GRAVITY, MountainCar

STEEPNESS = (0.8, 1.2)  # of the gravity that the sources know


@frozen(eq=False, slots=False)
class SteepCar(MountainCar):
    """Mountain cars whose gravity is `steepness` (R,) times as strong as Gymnasium's."""

    steepness: Tensor = field(factory=lambda: torch.ones(1))

    parameters: ClassVar[tuple[str, ...]] = ("speed", "steepness")

    def step(self, state: Tensor, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        position, velocity = state.unbind(1)
        more = (1 - self.steepness) * GRAVITY * (3 * position).cos()
        return super().step(torch.stack([position, velocity + more], 1), action, noise)


@frozen
class SteepCarFamily(MountainCarFamily):
    """Mountain car tasks with a gravity uniform in 0.8 to 1.2 of the usual one."""

    parameters = SteepCar.parameters
    kernel = ""

    def sample(self, rng: np.random.Generator, count: int) -> SteepCar:
        speed, steepness = rng.uniform(0.001, 0.0015, count), rng.uniform(*STEEPNESS, count)
        tasks = SteepCar.of(count, speed=speed, steepness=steepness)
        return evolve(tasks, last_reward=self.last_reward)
