"""Maze navigation: what it brings to the experiments."""

from collections.abc import Sequence

import numpy as np
import torch
from attrs import field, frozen
from torch import Tensor

from vtlab.envs.base import TaskFamily
from vtlab.envs.maze.library import library
from vtlab.envs.maze.plan import mean_return, plan_maze
from vtlab.envs.maze.tasks import Mazes
from vtlib.checks import kind
from vtlib.qfunctions import MLP

__all__ = ["MazeFamily", "Mazes"]


@frozen
class MazeFamily(TaskFamily):
    """Mazes of the library, each of `names` as likely; all twenty by default.

    Raises ValueError when there is no name, or an unknown one.
    """

    names: tuple[str, ...] = field(factory=lambda: tuple(library()), validator=kind(tuple))

    parameters = Mazes.parameters
    limits = (-0.02, 0.9)
    window = 25

    def __attrs_post_init__(self) -> None:
        Mazes.of(self.names)

    def q(self) -> MLP:
        """A network with two hidden layers of 32 units: 1,891 weights."""
        return MLP((22, 32, 32, 3))

    def optimum(self, tasks: Mazes) -> Tensor:
        """What the planned policy earns (R,). A maze's number is the same in every batch."""
        rows = torch.cat([tasks.walls.flatten(1).long(), tasks.goal], 1)
        mazes = rows.unique(dim=0, return_inverse=True)[1].tolist()
        returns = {maze: mean_return(plan_maze(tasks, mazes.index(maze))) for maze in set(mazes)}
        return torch.stack([returns[maze] for maze in mazes])

    def sample(self, rng: np.random.Generator, count: int) -> Mazes:
        return Mazes.of([self.names[i] for i in rng.integers(len(self.names), size=count)])

    def source_tasks(self, stream: str, sources: Sequence[int]) -> Mazes:
        """The family's mazes, one for each source of a pool, in the order of their names."""
        return Mazes.of([self.names[i] for i in sources])
