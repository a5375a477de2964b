"""Cartpole as a Gymnasium environment, over `Cartpole.step`."""

from typing import Any

import numpy as np
from gymnasium import spaces

from vtlab.envs.cartpole.tasks import ANGLE_LIMIT, POSITION_LIMIT, Cartpole
from vtlab.envs.gym import TasksEnv


class CartpoleEnv(TasksEnv):
    """A pole on a cart, to be kept upright by pushing the cart left and right.

    ## Description
    A pole turns freely on a cart that rolls without friction. Tasks differ in both masses and in
    the pole's length. Source: thesis section 6.2.1; by default as Gymnasium's CartPole-v1.

    ## Observation Space
    A `Box` of shape (4,), float32. An episode ends at half the bounds given here:

    | Num | Observation           | Min           | Max          | Unit  |
    | --- | --------------------- | ------------- | ------------ | ----- |
    | 0   | cart position         | -4.8          | 4.8          | m     |
    | 1   | cart velocity         | -Inf          | Inf          | m/s   |
    | 2   | pole angle            | -0.419 (-24°) | 0.419 (24°)  | rad   |
    | 3   | pole angular velocity | -Inf          | Inf          | rad/s |

    The angle is 0 for an upright pole and positive to the right.

    ## Action Space
    A `Discrete(2)`: 0 is LEFT, a force of -10 N on the cart, and 1 is RIGHT, 10 N.

    ## Transition Dynamics
    With masses *M* and *m*, half length *l*, force *F*, *g* = 9.8 m/s² and pole angle *θ*,

    - *u = (F + m l θ'² sin θ) / (M + m)*
    - *θ'' = (g sin θ - u cos θ) / (l (4/3 - m cos² θ / (M + m)))*
    - *x'' = u - m l θ'' cos θ / (M + m)*

    All four advance by 0.02 s times their rates before the step (Euler's method).

    ## Reward
    1 on every step, the last one too. The thesis discounts by 0.99 per step.

    ## Starting State
    Every observation is uniform in [-0.05, 0.05).

    ## Episode End
    Termination: the pole leans by more than 12°, or the cart is more than 2.4 m from the middle.
    Truncation: after `horizon` steps.

    ## Arguments
    - `cart_mass`, `pole_mass`: in kg. Default 1 and 0.1.
    - `half_length`: from the pivot to the pole's centre of mass, in m. Default 0.5.
    - `horizon`: steps of a truncated episode. Default 100.
    - `render_mode`: None or "rgb_array".
    """

    metadata = TasksEnv.metadata | {"render_fps": 50}
    drawing = "vtlab.envs.cartpole.draw:draw_cartpole"
    picture_size = (600, 300)

    def __init__(
        self,
        cart_mass: float = 1.0,
        pole_mass: float = 0.1,
        half_length: float = 0.5,
        **options: Any,
    ) -> None:
        tasks = Cartpole.of(1, cart_mass=cart_mass, pole_mass=pole_mass, half_length=half_length)
        # The space has twice the limits, as in Gymnasium, so that last observations lie inside.
        high = np.array([2 * POSITION_LIMIT, np.inf, 2 * ANGLE_LIMIT, np.inf], np.float32)
        super().__init__(tasks, spaces.Box(-high, high, dtype=np.float32), **options)
