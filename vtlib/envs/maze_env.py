"""Maze navigation as a Gymnasium environment, single and vectorised, over `Mazes.step`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from gymnasium import spaces

from vtlib.checks import check_kind
from vtlib.envs.maze import SENSORS, Mazes
from vtlib.envs.maze_geometry import REACH, SIDE
from vtlib.envs.mazes import Maze
from vtlib.envs.tasks_env import (
    TasksEnv,
    TasksVectorEnv,
    checked_count,
    env_metadata,
    vector_metadata,
)

MAZE = "north-east 1"
RENDER_FPS = 10


class MazeEnv(TasksEnv):
    """A robot with nine distance sensors in a maze, to be driven to the goal in a corner.

    ## Description
    A square of 10 x 10 m is made of cells, 1 m wide, that are walls or free; the goal is a cell in
    a corner.  A robot, small as a point, drives and turns in it and senses the walls around it.
    Tasks differ in the walls and the goal's corner.  Source: section 6.3 of the thesis.

    ## Observation Space
    A `Box` of shape (22,), float32:

    | Num   | Observation                            | Min | Max | Unit |
    | ----- | -------------------------------------- | --- | --- | ---- |
    | 0     | x                                      | 0   | 10  | m    |
    | 1     | y                                      | 0   | 10  | m    |
    | 2     | cosine of the heading                  | -1  | 1   |      |
    | 3     | sine of the heading                    | -1  | 1   |      |
    | 4-12  | distance to a wall along each ray      | 0   | 2   | m    |
    | 13-21 | 1 if the ray meets the goal, 0 if not  | 0   | 1   |      |

    The heading counts from the x axis to the left; the rays point -90, -67.5, ..., 90 degrees from
    it, the first to the right.  A wall or border farther than 2 m reads 2.  A ray meets the goal if
    the goal's cell lies on it within 2 m, before any wall.

    ## Action Space
    A `Discrete(3)`:

    | Num | Action  | Effect         |
    | --- | ------- | -------------- |
    | 0   | FORWARD | 0.5 m ahead    |
    | 1   | LEFT    | turn by π/8    |
    | 2   | RIGHT   | turn by -π/8   |

    ## Transition Dynamics
    With length *l(a)* and turn *w(a)* of the action and *z* three independent standard normal
    numbers,

    *x' = x + l(a) cos θ + 0.05 z₁*

    *y' = y + l(a) sin θ + 0.05 z₂*

    *θ' = θ + w(a) + 0.05 z₃*

    A move that meets a wall or the border on its straight way ends 1 cm before it.

    ## Reward
    1 on a step that ends in the goal's cell, and 0 on any other.  The thesis discounts by 0.99 per
    step.

    ## Starting State
    Uniform over the free cells but the goal's, over the cell (less a rim of 1 cm) and the headings.

    ## Episode End
    1. Termination: the robot is in the goal's cell after a step.
    2. Truncation: `horizon` steps have been made.

    ## Arguments
    - `maze`: the name of a maze in the library, such as "south-west 4", or one's own, read by
      `vtlib.envs.mazes.parse_maze`.  Default "north-east 1".
    - `horizon`: steps after which an episode is truncated.  Default 100.
    - `render_mode`: None or "rgb_array".

    Raises ValueError when an argument or an action is out of range.

    ## Version History
    - v0: first version.
    """

    metadata = env_metadata(RENDER_FPS)

    def __init__(
        self,
        maze: str | Maze = MAZE,
        horizon: int = Mazes.horizon,
        render_mode: str | None = None,
    ) -> None:
        super().__init__(Mazes.of([maze]), _box(), _frame, horizon, render_mode)


class MazeVectorEnv(TasksVectorEnv):
    """Many mazes in one batch; row i behaves exactly as a `MazeEnv` of seed + i.

    Arguments as for `MazeEnv`, and `num_envs`; `maze` is one for all rows, or a sequence of
    `num_envs`.  Rows start anew as `TasksVectorEnv` says.
    """

    metadata = vector_metadata(RENDER_FPS)

    def __init__(
        self,
        num_envs: int = 1,
        maze: str | Maze | Sequence[str | Maze] = MAZE,
        horizon: int = Mazes.horizon,
        render_mode: str | None = None,
    ) -> None:
        count = checked_count(num_envs)
        if not isinstance(maze, str | Maze):
            check_kind("maze", maze, Sequence)
        mazes = [maze] * count if isinstance(maze, str | Maze) else list(maze)
        if len(mazes) != count:
            raise ValueError(f"maze must be one, or a sequence of {count}, got {len(mazes)}")
        super().__init__(Mazes.of(mazes), _box(), _frame, horizon, render_mode)


def _box() -> spaces.Box:
    low = [0, 0, -1, -1] + [0] * 2 * SENSORS
    high = [SIDE, SIDE, 1, 1] + [REACH] * SENSORS + [1] * SENSORS
    return spaces.Box(np.array(low, np.float32), np.array(high, np.float32), dtype=np.float32)


def _frame(tasks: Mazes, index: int, state: np.ndarray) -> np.ndarray:
    # matplotlib takes most of a second to import and only pictures need it.
    from vtlib.envs.draw_maze import maze_frame

    return maze_frame(tasks, index, state)
