"""The rooms problem: what it brings to the experiments."""

from collections.abc import Sequence
from typing import cast

import attrs
import numpy as np
import torch
from attrs import field, frozen
from torch import Tensor

from vtlab.envs.base import TaskFamily
from vtlab.envs.rooms.plan import plan_rooms
from vtlab.envs.rooms.tasks import DOOR_RANGE, Rooms
from vtlib.checks import check_between, check_positive, check_whole, kind, shown, whole
from vtlib.episodes import Tasks
from vtlib.qfunctions import RBFLinear

__all__ = ["Rooms", "RoomsFamily"]

START_CELLS = 50  # per axis, whose middles stand for starts anywhere


@frozen
class RoomsFamily(TaskFamily):
    """A distribution over rooms tasks: doors uniform in [0.5, 9.5] unless told otherwise.

    `rooms` is 2 or 3; `fixed_lower` puts the lowest door at one place in every task (thesis
    6.1.2); `normal` = (mean, standard deviation) draws the doors from a Normal distribution,
    clipped to [0.5, 9.5] (thesis 6.1.4); `ladder` has the targets' doors go through so many evenly
    spaced places in turn, one task after the other. The frontier lets agents slide unless it
    `stops` them. Raises ValueError on any other value.
    """

    rooms: int = 3
    fixed_lower: float | None = None
    normal: tuple[float, float] | None = None
    ladder: int = field(default=0, validator=whole(0))
    stops: bool = field(default=False, validator=kind(bool))

    parameters = Rooms.parameters
    limits = (-0.02, 0.9)
    scale = 0.0
    kernel = "rooms"

    def __attrs_post_init__(self) -> None:
        check_whole("rooms", self.rooms, 2, 3)
        if self.fixed_lower is not None:
            check_between("fixed_lower", self.fixed_lower, *DOOR_RANGE)
        if self.normal is not None:
            if not (isinstance(self.normal, tuple) and len(self.normal) == 2):
                raise ValueError(f"normal must be (mean, deviation), got {shown(self.normal)}")
            check_between("the mean in normal", self.normal[0], *DOOR_RANGE)
            check_positive("the deviation in normal", self.normal[1])

    def q(self) -> RBFLinear:
        """121 normalised radial bases for each of 4 actions: 484 weights."""
        return RBFLinear(torch.arange(11.0), 1 / 9, Rooms.n_actions)

    def optimum(self, tasks: Rooms) -> Tensor:
        """Best expected discounted return (R,) of one episode, cut at the horizon.

        From (0, 0), or the mean over starts anywhere in the square for tasks that start there.
        """
        u = torch.zeros(1, 2)
        if tasks.uniform_start:
            middles = (torch.arange(START_CELLS) + 0.5) / START_CELLS
            u = torch.cartesian_prod(middles, middles)
        plans = [plan_rooms(tasks, index) for index in range(len(tasks))]
        return torch.stack([one.value(tasks.start(u)).mean() for one in plans])

    def sample(self, rng: np.random.Generator, count: int) -> Rooms:
        """Draw `count` tasks, independent and alike. Raises ValueError when count < 1."""
        check_whole("count", count)
        shape = (count, self.rooms - 1)
        if self.normal is None:
            doors = rng.uniform(*DOOR_RANGE, shape)
        else:
            doors = rng.normal(*self.normal, shape).clip(*DOOR_RANGE)
        if self.fixed_lower is not None:
            doors[:, 0] = self.fixed_lower
        return Rooms.from_doors(doors, stops=self.stops)

    def draw_tasks(self, stream: str, runs: Sequence[int]) -> Rooms:
        """One task for each run, whatever the other runs are."""
        if not self.ladder:
            return cast(Rooms, super().draw_tasks(stream, runs))
        rungs = np.linspace(*DOOR_RANGE, self.ladder)[np.array(runs) % self.ladder]
        return Rooms.from_doors(np.repeat(rungs[:, None], self.rooms - 1, 1), stops=self.stops)

    def source_tasks(self, stream: str, sources: Sequence[int]) -> Tasks:
        """The tasks of some sources of a pool: each drawn from a generator of its own."""
        return super().draw_tasks(stream, sources)

    def kernel_parameters(self, tasks: Rooms, row: int) -> list[float]:
        """Both doors, the number of walls, whether starts are anywhere and the frontier stops."""
        doors = tasks.doors[row].tolist()
        return [doors[0], doors[-1], len(doors), tasks.uniform_start, tasks.stops]

    def for_sources(self, tasks: Rooms) -> Rooms:
        """The same rooms with episodes that start anywhere.

        From the corner alone, chance rarely finds the goal.
        """
        return attrs.evolve(tasks, uniform_start=True)
