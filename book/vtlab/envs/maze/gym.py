"""Maze navigation as a Gymnasium environment, over `Mazes.step`."""

from typing import Any

import numpy as np
from gymnasium import spaces

from vtlab.envs.gym import TasksEnv
from vtlab.envs.maze.geometry import REACH, SIDE
from vtlab.envs.maze.tasks import SENSORS, Mazes


class MazeEnv(TasksEnv):
    """A robot with nine distance sensors in a maze, to be driven to the goal in a corner.

    Observations are the position x, y (m), cosine and sine of the heading, the distance to a wall
    along each ray (m, at most 2), and for each ray whether it meets the goal. Rays are -90, -67.5,
    ..., 90 degrees from the heading. Actions are 0 for 0.5 m ahead, 1 for a turn by 22.5 degrees to
    the left and 2 for one to the right. Reaching the goal's cell earns 1 and ends the episode.
    ``maze`` is a name in `vtlab.envs.maze.library`. Source: thesis section 6.3.
    """

    metadata = TasksEnv.metadata | {"render_fps": 10}
    drawing = "vtlab.envs.maze.draw:draw_maze"

    def __init__(self, maze: str = "north-east 0", **options: Any) -> None:
        low = np.array([0, 0, -1, -1, *[0] * 2 * SENSORS], np.float32)
        high = np.array([SIDE, SIDE, 1, 1, *[REACH] * SENSORS, *[1] * SENSORS], np.float32)
        space = spaces.Box(low, high, dtype=np.float32)
        super().__init__(Mazes.of([maze]), space, **options)
