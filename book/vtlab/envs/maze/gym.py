"""Maze navigation as a Gymnasium environment, over `Mazes.step`."""

from typing import Any

import numpy as np
from gymnasium import spaces

from vtlab.envs.gym import TasksEnv
from vtlab.envs.maze.geometry import REACH, SIDE
from vtlab.envs.maze.tasks import SENSORS, Mazes


class MazeEnv(TasksEnv):
    """A robot with nine distance sensors in a maze, to be driven to the goal in a corner.

    ## Description
    A square of 10 x 10 m is made of cells, 1 m wide, that are walls or free. A robot, a point,
    drives to the goal, a corner cell. Tasks differ in walls and goal. Source: thesis section 6.3.

    ## Observation Space
    A `Box` of shape (22,), float32:

    | Num   | Observation                            | Min | Max | Unit |
    | ----- | -------------------------------------- | --- | --- | ---- |
    | 0, 1  | position x, y                          | 0   | 10  | m    |
    | 2, 3  | cosine and sine of the heading         | -1  | 1   |      |
    | 4-12  | distance to a wall along each ray      | 0   | 2   | m    |
    | 13-21 | 1 if the ray meets the goal, 0 if not  | 0   | 1   |      |

    The heading counts from the x axis to the left, and the rays -90, -67.5, ..., 90 degrees from
    it. They see walls, the border and the goal's cell, up to 2 m away and not behind a wall.

    ## Action Space
    A `Discrete(3)`: 0 is FORWARD, 0.5 m ahead; 1 is LEFT, a turn by π/8; 2 is RIGHT, by -π/8.

    ## Transition Dynamics
    With length *l* and turn *w* of the action and *z* three standard normal numbers,

    - *x' = x + l cos θ + 0.05 z₁*
    - *y' = y + l sin θ + 0.05 z₂*
    - *θ' = θ + w + 0.05 z₃*

    A move that meets a wall ends 1 cm before it; the border cuts x and y each by itself (sliding).

    ## Reward
    1 on a step that ends in the goal's cell, else 0. The thesis discounts by 0.99 per step.

    ## Starting State
    Uniform over the free cells but the goal's, over the cell (less a rim of 1 cm) and the headings.

    ## Episode End
    Termination: a step ends in the goal's cell. Truncation: after `horizon` steps.

    ## Arguments
    - `maze`: a name in `vtlab.envs.maze.library`. Default "north-east 0".
    - `horizon`: steps of a truncated episode. Default 100.
    - `render_mode`: None or "rgb_array".
    """

    metadata = TasksEnv.metadata | {"render_fps": 10}
    drawing = "vtlab.envs.maze.draw:draw_maze"

    def __init__(self, maze: str = "north-east 0", **options: Any) -> None:
        low = np.array([0, 0, -1, -1, *[0] * 2 * SENSORS], np.float32)
        high = np.array([SIDE, SIDE, 1, 1, *[REACH] * SENSORS, *[1] * SENSORS], np.float32)
        space = spaces.Box(low, high, dtype=np.float32)
        super().__init__(Mazes.of([maze]), space, **options)
