"""Mountain car as a Gymnasium environment, single and vectorised, over `MountainCar.step`."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from vtlib.envs.mountain_car import MAX_SPEED, POSITIONS, MountainCar
from vtlib.envs.tasks_env import (
    TasksEnv,
    TasksVectorEnv,
    checked_count,
    env_metadata,
    vector_metadata,
)

SPEED = 0.001  # Gymnasium's MountainCar-v0
RENDER_FPS = 30


class MountainCarEnv(TasksEnv):
    """A car in a valley, too weak to climb out without swinging to and fro.

    ## Description
    A car is to reach the top of the hill on its right.  Its engine cannot drive it straight up, so
    it has to gain momentum on the hill on its left.  Tasks differ in the velocity that the engine
    adds per step.  Source: section 6.2.2 of the thesis; with the default arguments the dynamics
    are those of Gymnasium's MountainCar-v0.

    ## Observation Space
    A `Box` of shape (2,), float32:

    | Num | Observation | Min   | Max  | Unit            |
    | --- | ----------- | ----- | ---- | --------------- |
    | 0   | position    | -1.2  | 0.6  | length          |
    | 1   | velocity    | -0.07 | 0.07 | length per step |

    ## Action Space
    A `Discrete(3)`:

    | Num | Action | Velocity added |
    | --- | ------ | -------------- |
    | 0   | LEFT   | -`speed`       |
    | 1   | NONE   | 0              |
    | 2   | RIGHT  | `speed`        |

    ## Transition Dynamics
    *v' = clip(v + (a - 1) speed - 0.0025 cos(3 x), -0.07, 0.07)*

    *x' = clip(x + v', -1.2, 0.6)*

    A car that hits the left end of the track stops: *v' = 0* there if it was negative.  The height
    of the ground is proportional to *sin(3 x)*.

    ## Reward
    -1 on every step and 0 on the one that reaches the goal (Gymnasium's is -1 there too).  The
    thesis discounts by 0.99 per step.

    ## Starting State
    At rest, the position uniform in [-0.9, 0).

    ## Episode End
    1. Termination: the position is at least 0.5.
    2. Truncation: `horizon` steps have been made.

    ## Arguments
    - `speed`: velocity that an action adds, in length per step.  Default 0.001.
    - `horizon`: steps after which an episode is truncated.  Default 200.
    - `render_mode`: None or "rgb_array".

    Raises ValueError when an argument or an action is out of range.

    ## Version History
    - v0: first version.
    """

    metadata = env_metadata(RENDER_FPS)

    def __init__(
        self,
        speed: float = SPEED,
        horizon: int = MountainCar.horizon,
        render_mode: str | None = None,
    ) -> None:
        tasks = MountainCar.of(1, speed=speed)
        super().__init__(tasks, _box(), _frame, horizon, render_mode)


class MountainCarVectorEnv(TasksVectorEnv):
    """Many mountain cars in one batch; row i behaves exactly as a `MountainCarEnv` of seed + i.

    Arguments as for `MountainCarEnv`, and `num_envs`; `speed` is a number for all rows or has
    shape (num_envs,).  Rows start anew as `TasksVectorEnv` says.
    """

    metadata = vector_metadata(RENDER_FPS)

    def __init__(
        self,
        num_envs: int = 1,
        speed: ArrayLike = SPEED,
        horizon: int = MountainCar.horizon,
        render_mode: str | None = None,
    ) -> None:
        tasks = MountainCar.of(checked_count(num_envs), speed=speed)
        super().__init__(tasks, _box(), _frame, horizon, render_mode)


def _box() -> spaces.Box:
    low, high = POSITIONS
    bounds = np.array([[low, -MAX_SPEED], [high, MAX_SPEED]], np.float32)
    return spaces.Box(bounds[0], bounds[1], dtype=np.float32)


def _frame(tasks: MountainCar, index: int, state: np.ndarray) -> np.ndarray:
    # matplotlib takes most of a second to import and only pictures need it.
    from vtlib.envs.draw_control import mountain_car_frame

    return mountain_car_frame(tasks, index, state)
