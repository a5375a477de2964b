"""Mountain car as a Gymnasium environment, over `MountainCar.step`."""

from typing import Any

import numpy as np
from gymnasium import spaces

from vtlab.envs.gym import TasksEnv
from vtlab.envs.mountain_car.tasks import MAX_SPEED, POSITIONS, MountainCar


class MountainCarEnv(TasksEnv):
    """A car in a valley, too weak to climb out without swinging to and fro.

    Observations are position and velocity. Actions are 0 for left, 1 for none and 2 for right, and
    add -``speed``, 0 or ``speed`` to the velocity. Each step earns -1, but 0 the one that reaches
    the goal, where the episode ends, unlike Gymnasium's. Source: thesis section 6.2.2; the default
    is that of Gymnasium's MountainCar-v0.
    """

    metadata = TasksEnv.metadata | {"render_fps": 30}
    drawing = "vtlab.envs.mountain_car.draw:draw_mountain_car"
    picture_size = (600, 400)

    def __init__(self, speed: float = 0.001, **options: Any) -> None:
        low, high = np.array([POSITIONS, (-MAX_SPEED, MAX_SPEED)], np.float32).T
        space = spaces.Box(low, high, dtype=np.float32)
        super().__init__(MountainCar.of(1, speed=speed), space, **options)
