"""The rooms problem as a Gymnasium environment, over `Rooms.step`."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces

from vtlab.envs.gym import TasksEnv
from vtlab.envs.rooms.tasks import SIDE, Rooms


class RoomsEnv(TasksEnv):
    """A square cut into rooms by walls with doors, to be crossed to its far corner.

    Observations are the position x, y in a square of 10 x 10. Actions are 0 for up, 1 for right, 2
    for down and 3 for left. Reaching the corner earns 1 and ends the episode. ``doors`` are their
    centres in [0.5, 9.5], lowest wall first; ``uniform_start`` starts anywhere in the square, not
    at (0, 0). Source: thesis section 6.1.
    """

    metadata = TasksEnv.metadata | {"render_fps": 5}
    drawing = "vtlab.envs.rooms.draw:draw_rooms"

    def __init__(
        self, doors: Sequence[float] = (5.0, 5.0), uniform_start: bool = False, **options: Any
    ) -> None:
        tasks = Rooms.from_doors(doors, uniform_start)
        if len(tasks) != 1:
            raise ValueError(f"doors must have shape (W,), got {tuple(tasks.doors.shape)}")
        super().__init__(tasks, spaces.Box(0.0, SIDE, (Rooms.obs_dim,), np.float32), **options)
