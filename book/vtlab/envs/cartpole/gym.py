"""Cartpole as a Gymnasium environment, over `Cartpole.step`."""

from typing import Any

import numpy as np
from gymnasium import spaces

from vtlab.envs.cartpole.tasks import ANGLE_LIMIT, POSITION_LIMIT, Cartpole
from vtlab.envs.gym import TasksEnv


class CartpoleEnv(TasksEnv):
    """A pole on a cart, to be kept upright by pushing the cart left and right.

    Observations are the cart's position (m) and velocity (m/s), the pole's angle (rad, 0 upright
    and positive to the right) and angular velocity (rad/s). Actions are 0 for left and 1 for right.
    Each step earns 1, until the pole leans by more than 12 degrees or the cart is more than 2.4 m
    from the middle. Masses are in kg; ``half_length`` is from the pivot to the pole's centre of
    mass, in m. Source: thesis section 6.2.1; the defaults are those of Gymnasium's CartPole-v1.
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
