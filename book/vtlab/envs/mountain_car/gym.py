"""Mountain car as a Gymnasium environment, over `MountainCar.step`."""

from typing import Any

import numpy as np
from gymnasium import spaces

from vtlab.envs.gym import TasksEnv
from vtlab.envs.mountain_car.tasks import MAX_SPEED, POSITIONS, MountainCar


class MountainCarEnv(TasksEnv):
    """A car in a valley, too weak to climb out without swinging to and fro.

    ## Description
    A car is to reach the top of the hill on its right. Tasks differ in the velocity that its engine
    adds per step. Source: thesis section 6.2.2; by default as Gymnasium's MountainCar-v0.

    ## Observation Space
    A `Box` of shape (2,), float32:

    | Num | Observation | Min   | Max  | Unit            |
    | --- | ----------- | ----- | ---- | --------------- |
    | 0   | position    | -1.2  | 0.6  | length          |
    | 1   | velocity    | -0.07 | 0.07 | length per step |

    ## Action Space
    A `Discrete(3)`: LEFT, NONE and RIGHT, which add -`speed`, 0 and `speed` to the velocity.

    ## Transition Dynamics
    - *v' = clip(v + (a - 1) speed - 0.0025 cos(3 x), -0.07, 0.07)*
    - *x' = clip(x + v', -1.2, 0.6)*

    A car that hits the left end of the track stops. The ground is *sin(3 x)* high, to a scale.

    ## Reward
    -1, but 0 on the step that reaches the goal, unlike Gymnasium's. The thesis discounts by 0.99.

    ## Starting State
    At rest, the position uniform in [-0.9, 0).

    ## Episode End
    Termination: the position is at least 0.5. Truncation: after `horizon` steps.

    ## Arguments
    - `speed`: velocity that an action adds, in length per step. Default 0.001.
    - `horizon`: steps of a truncated episode. Default 200.
    - `render_mode`: None or "rgb_array".
    """

    metadata = TasksEnv.metadata | {"render_fps": 30}
    drawing = "vtlab.envs.mountain_car.draw:draw_mountain_car"
    picture_size = (600, 400)

    def __init__(self, speed: float = 0.001, **options: Any) -> None:
        low, high = np.array([POSITIONS, (-MAX_SPEED, MAX_SPEED)], np.float32).T
        space = spaces.Box(low, high, dtype=np.float32)
        super().__init__(MountainCar.of(1, speed=speed), space, **options)
