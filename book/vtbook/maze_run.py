"""Six walks in the maze of a first run, by any policy, and how they are drawn."""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from matplotlib.axes import Axes
from torch import Tensor

from vtbook.paths import walks
from vtlab.envs.maze import Mazes
from vtlab.envs.maze.draw import draw_maze
from vtlab.experiment import Experiment
from vtlab.run import targets
from vtlib.rng import generator

STARTS = 6
Policy = Callable[[Tensor], Tensor]  # actions (B,) at states (B, 3)


def maze_of(experiment: Experiment) -> Mazes:
    """The maze of the first run."""
    tasks = targets(experiment, [0])
    assert isinstance(tasks, Mazes)
    return tasks


def six_walks(experiment: Experiment, policy: Policy) -> list[np.ndarray]:
    """States (T, 3) of six walks; starts and noise are the same for every policy."""
    rng = generator(experiment.stream, 0, "walks")
    copies = maze_of(experiment).select([0] * STARTS)
    start = copies.start(torch.from_numpy(rng.random((STARTS, Mazes.start_dim))))
    noise = rng.standard_normal((Mazes.horizon, STARTS, Mazes.noise_dim))
    return walks(copies, policy, start, torch.from_numpy(noise))


def draw_walks(
    ax: Axes, maze: Mazes, paths: Sequence[np.ndarray], colour: str, along: float
) -> None:
    """Walks with their starts as dots, and the first one's robot that far along its way."""
    first = paths[0]
    draw_maze(ax, maze, 0, first[round(along * (len(first) - 1))])
    for path in paths:
        ax.plot(*path[:, :2].T, color=colour, lw=1.1, alpha=0.8)
        ax.plot(*path[0, :2], "o", color=colour, ms=3.5)
