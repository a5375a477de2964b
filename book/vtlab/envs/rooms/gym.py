"""The rooms problem as a Gymnasium environment, over `Rooms.step`."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces

from vtlab.envs.base import float_array
from vtlab.envs.gym import TasksEnv
from vtlab.envs.rooms.tasks import SIDE, Rooms


class RoomsEnv(TasksEnv):
    """A square cut into rooms by walls with doors, to be crossed to its far corner.

    ## Description
    An agent walks from the bottom left corner of a 10 x 10 square to the top right one. Walls cut
    it into rooms of equal height; each wall has one door, 1 wide. Tasks differ in where the doors
    are. Source: thesis section 6.1.

    ## Observation Space
    A `Box(0, 10, (2,), float32)`: the position x, y, in units of length.

    ## Action Space
    A `Discrete(4)`: 0 is UP (0, 1), 1 is RIGHT (1, 0), 2 is DOWN (0, -1) and 3 is LEFT (-1, 0).

    ## Transition Dynamics
    With *e(a)* the direction above and *z* two independent standard normal numbers,

    *p = clip(s + e(a) + 0.2 z, 0, 10)*

    *s' = s* if the segment from *s* to *p* crosses a wall outside its door, and *s' = p* otherwise.

    ## Reward
    1 on a step that ends within 1 of (10, 10), else 0. The thesis discounts by 0.99 per step.

    ## Starting State
    (0, 0); with `uniform_start` anywhere in the square, uniformly.

    ## Episode End
    Termination: a step ends within 1 of (10, 10). Truncation: after `horizon` steps.

    ## Arguments
    - `doors`: their centres, in [0.5, 9.5], lowest wall first. Default (5, 5), for three rooms.
    - `uniform_start`: start anywhere in the square. Default False.
    - `horizon`: steps of a truncated episode. Default 50.
    - `render_mode`: None or "rgb_array".
    """

    metadata = TasksEnv.metadata | {"render_fps": 5}
    drawing = "vtlab.envs.rooms.draw:draw_rooms"

    def __init__(
        self, doors: Sequence[float] = (5.0, 5.0), uniform_start: bool = False, **options: Any
    ) -> None:
        centres = float_array("doors", doors)
        if centres.ndim != 1:
            raise ValueError(f"doors must have shape (W,), got {centres.shape}")
        space = spaces.Box(0.0, SIDE, (Rooms.obs_dim,), np.float32)
        super().__init__(Rooms.from_doors(centres, uniform_start), space, **options)
