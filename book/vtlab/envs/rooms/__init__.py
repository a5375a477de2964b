"""The rooms problem: what it brings to the experiments."""

from collections.abc import Sequence
from typing import cast

import attrs
import numpy as np
import torch
from attrs import field, frozen
from attrs.validators import optional
from torch import Tensor

from vtlab.bases import RBFLinear
from vtlab.envs.base import TaskFamily
from vtlab.envs.rooms.plan import plan_rooms
from vtlab.envs.rooms.tasks import DOOR_RANGE, Rooms
from vtlib.checks import between, check_between, check_positive, kind, shown, whole

__all__ = ["Rooms", "RoomsFamily"]

START_CELLS = 50  # cells per axis; their middles stand for starts anywhere


@frozen
class RoomsFamily(TaskFamily):
    """A distribution over rooms tasks: doors uniform in [0.5, 9.5] unless a field says otherwise.

    Raises ValueError for a value outside its range.
    """

    #: How many rooms there are, 2 or 3.
    rooms: int = field(default=3, validator=whole(2, 3))
    #: Where the lowest door is in every task (thesis 6.1.2).
    fixed_lower: float | None = field(default=None, validator=optional(between(*DOOR_RANGE)))
    #: Mean and deviation of normal doors, which are clipped to [0.5, 9.5] (thesis 6.1.4).
    normal: tuple[float, float] | None = None
    #: Through how many evenly spaced places the doors of the targets go, task by task.
    ladder: int = field(default=0, validator=whole(0))
    #: Whether the outer wall stops agents, which else slide along it.
    stops: bool = field(default=False, validator=kind(bool))

    parameters = Rooms.parameters
    limits = (-0.02, 0.9)
    scale = 0.0
    kernel = "rooms"

    def __attrs_post_init__(self) -> None:
        if self.normal is not None:
            if not (isinstance(self.normal, tuple) and len(self.normal) == 2):
                raise ValueError(f"normal must be (mean, deviation), got {shown(self.normal)}")
            check_between("the mean in normal", self.normal[0], *DOOR_RANGE)
            check_positive("the deviation in normal", self.normal[1])

    def q(self) -> RBFLinear:
        """121 normalised radial bases for each of 4 actions: 484 weights."""
        return RBFLinear(torch.arange(11.0), 1 / 9, Rooms.n_actions)

    def optimum(self, tasks: Rooms) -> Tensor:
        """Best expected discounted return (R,) of an episode, over all starts that a task has."""
        u = torch.zeros(1, 2)
        if tasks.uniform_start:
            middles = (torch.arange(START_CELLS) + 0.5) / START_CELLS
            u = torch.cartesian_prod(middles, middles)
        plans = [plan_rooms(tasks, index) for index in range(len(tasks))]
        return torch.stack([plan.value(tasks.start(u)).mean() for plan in plans])

    def sample(self, rng: np.random.Generator, count: int) -> Rooms:
        shape = (count, self.rooms - 1)
        if self.normal is None:
            doors = rng.uniform(*DOOR_RANGE, shape)
        else:
            doors = rng.normal(*self.normal, shape).clip(*DOOR_RANGE)
        if self.fixed_lower is not None:
            doors[:, 0] = self.fixed_lower
        return Rooms.from_doors(doors, stops=self.stops)

    def draw_tasks(self, stream: str, runs: Sequence[int]) -> Rooms:
        if not self.ladder:
            return cast(Rooms, super().draw_tasks(stream, runs))
        rungs = np.linspace(*DOOR_RANGE, self.ladder)[np.array(runs) % self.ladder]
        return Rooms.from_doors(np.repeat(rungs[:, None], self.rooms - 1, 1), stops=self.stops)

    def kernel_parameters(self, tasks: Rooms, row: int) -> list[float]:
        """Both doors, how many there are, whether starts are anywhere, whether the border stops."""
        doors = tasks.doors[row].tolist()
        return [doors[0], doors[-1], len(doors), tasks.uniform_start, tasks.stops]

    def for_sources(self, tasks: Rooms) -> Rooms:
        """The same rooms with starts anywhere: from the corner chance rarely finds the goal."""
        return attrs.evolve(tasks, uniform_start=True)
