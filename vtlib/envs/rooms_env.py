"""The rooms problem as a Gymnasium environment, single and vectorised, over `Rooms.step`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from vtlib.envs.batch import float_array
from vtlib.envs.rooms import SIDE, Rooms
from vtlib.envs.tasks_env import (
    TasksEnv,
    TasksVectorEnv,
    checked_count,
    env_metadata,
    vector_metadata,
)

DOORS = (5.0, 5.0)
RENDER_FPS = 5


class RoomsEnv(TasksEnv):
    """A square cut into rooms by walls with doors, to be crossed to its far corner.

    ## Description
    An agent walks from the bottom left corner of a 10 x 10 square to the top right one.  Walls
    cut the square into rooms of equal height; each has one door, 1 wide.  Tasks differ only in
    where the doors are.  Source: section 6.1 of the thesis.

    ## Observation Space
    A `Box(0, 10, (2,), float32)`, in units of length:

    | Num | Observation | Min | Max | Unit   |
    | --- | ----------- | --- | --- | ------ |
    | 0   | x           | 0   | 10  | length |
    | 1   | y           | 0   | 10  | length |

    ## Action Space
    A `Discrete(4)`:

    | Num | Action | Direction |
    | --- | ------ | --------- |
    | 0   | UP     | (0, 1)    |
    | 1   | RIGHT  | (1, 0)    |
    | 2   | DOWN   | (0, -1)   |
    | 3   | LEFT   | (-1, 0)   |

    ## Transition Dynamics
    With *e(a)* the direction above and *z* two independent standard normal numbers,

    *p = clip(s + e(a) + 0.2 z, 0, 10)*

    *s' = s* if the segment from *s* to *p* crosses a wall outside its door, and *s' = p* otherwise.

    ## Reward
    1 on a step that ends within distance 1 of (10, 10), and 0 on any other.  The thesis discounts
    by 0.99 per step.

    ## Starting State
    (0, 0); with `uniform_start` anywhere in the square, uniformly.

    ## Episode End
    1. Termination: the agent is within distance 1 of (10, 10) after a step.
    2. Truncation: `horizon` steps have been made.

    ## Arguments
    - `doors`: centres of the doors, in [0.5, 9.5], lowest wall first; as many as walls, so two
      for three rooms.  Default (5, 5).
    - `uniform_start`: start anywhere in the square.  Default False.
    - `horizon`: steps after which an episode is truncated.  Default 50.
    - `render_mode`: None or "rgb_array".

    Raises ValueError when an argument or an action is out of range.

    ## Version History
    - v0: first version.
    """

    metadata = env_metadata(RENDER_FPS)

    def __init__(
        self,
        doors: Sequence[float] = DOORS,
        uniform_start: bool = False,
        horizon: int = Rooms.horizon,
        render_mode: str | None = None,
    ) -> None:
        tasks = _tasks(doors, 1, uniform_start)
        super().__init__(tasks, _box(), _frame, horizon, render_mode)


class RoomsVectorEnv(TasksVectorEnv):
    """Many rooms environments in one batch; row i behaves exactly as a `RoomsEnv` of seed + i.

    Arguments as for `RoomsEnv`, and `num_envs`; `doors` has shape (W,) for one task everywhere or
    (num_envs, W) for one task per row.  Rows start anew as `TasksVectorEnv` says.
    """

    metadata = vector_metadata(RENDER_FPS)

    def __init__(
        self,
        num_envs: int = 1,
        doors: ArrayLike = DOORS,
        uniform_start: bool = False,
        horizon: int = Rooms.horizon,
        render_mode: str | None = None,
    ) -> None:
        tasks = _tasks(doors, checked_count(num_envs), uniform_start)
        super().__init__(tasks, _box(), _frame, horizon, render_mode)


def _box() -> spaces.Box:
    return spaces.Box(0.0, SIDE, (Rooms.obs_dim,), np.float32)


def _tasks(doors: ArrayLike, count: int, uniform_start: bool) -> Rooms:
    centres = float_array("doors", doors)
    if centres.ndim == 1:
        centres = np.tile(centres, (count, 1))
    tasks = Rooms.from_doors(centres, uniform_start)
    if len(tasks) != count:
        raise ValueError(f"doors must have shape (W,) or ({count}, W), got {centres.shape}")
    return tasks


def _frame(tasks: Rooms, index: int, state: np.ndarray) -> np.ndarray:
    # matplotlib takes most of a second to import and only pictures need it.
    from vtlib.envs.draw import frame

    return frame(tasks, index, state)
