"""Mazes whose border stops robots that touch it, where the thesis' slide along it."""

import numpy as np
from attrs import frozen

from vtlab.envs.maze import MazeFamily, Mazes
from vtlab.envs.maze.geometry import BORDER, SIDE


@frozen(eq=False, slots=False)
class StoppingMazes(Mazes):
    """The same mazes, in which a move goes no further than to the border."""

    def _advance(self, position: np.ndarray, move: np.ndarray) -> np.ndarray:
        aim = position + move
        edge = aim.clip(BORDER, SIDE - BORDER)
        cut = (aim != edge) & (move != 0)
        share = np.divide(edge - position, move, out=np.ones_like(move), where=cut).min(0)
        return super()._advance(position, share.clip(0) * move)


@frozen
class StoppingMazeFamily(MazeFamily):
    """The library's mazes, or some of them, with such a border."""

    def sample(self, rng: np.random.Generator, count: int) -> StoppingMazes:
        """Draw `count` tasks as the library's are drawn."""
        tasks = super().sample(rng, count)
        return StoppingMazes(tasks.walls, tasks.goal)
