"""Cartpole as a Gymnasium environment, single and vectorised, over `Cartpole.step`."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from vtlib.envs.cartpole import ANGLE_LIMIT, POSITION_LIMIT, Cartpole
from vtlib.envs.tasks_env import (
    TasksEnv,
    TasksVectorEnv,
    checked_count,
    env_metadata,
    vector_metadata,
)

# Gymnasium's CartPole-v1.
CART_MASS, POLE_MASS, HALF_LENGTH = 1.0, 0.1, 0.5
RENDER_FPS = 50


class CartpoleEnv(TasksEnv):
    """A pole on a cart, to be kept upright by pushing the cart left and right.

    ## Description
    A pole turns freely about a pivot on a cart, which rolls without friction on a straight track.
    Tasks differ in both masses and in the length of the pole.  Source: section 6.2.1 of the
    thesis; with the default arguments the dynamics are those of Gymnasium's CartPole-v1.

    ## Observation Space
    A `Box` of shape (4,), float32.  An episode ends at half the bounds given here:

    | Num | Observation           | Min           | Max          | Unit  |
    | --- | --------------------- | ------------- | ------------ | ----- |
    | 0   | cart position         | -4.8          | 4.8          | m     |
    | 1   | cart velocity         | -Inf          | Inf          | m/s   |
    | 2   | pole angle            | -0.419 (-24°) | 0.419 (24°)  | rad   |
    | 3   | pole angular velocity | -Inf          | Inf          | rad/s |

    The angle is 0 when the pole stands upright and positive when it leans to the right.

    ## Action Space
    A `Discrete(2)`:

    | Num | Action | Force on the cart |
    | --- | ------ | ----------------- |
    | 0   | LEFT   | -10 N             |
    | 1   | RIGHT  | 10 N              |

    ## Transition Dynamics
    With cart mass *M*, pole mass *m*, half length *l*, force *F*, gravity *g* = 9.8 m/s² and pole
    angle *θ*,

    *u = (F + m l θ'² sin θ) / (M + m)*

    *θ'' = (g sin θ - u cos θ) / (l (4/3 - m cos² θ / (M + m)))*

    *x'' = u - m l θ'' cos θ / (M + m)*

    Position, angle and both velocities advance by 0.02 s times their rates before the step
    (Euler's method).

    ## Reward
    1 on every step, the last one too.  The thesis discounts by 0.99 per step.

    ## Starting State
    Every observation is uniform in [-0.05, 0.05).

    ## Episode End
    1. Termination: the pole leans by more than 12°.
    2. Termination: the cart is more than 2.4 m from the middle of the track.
    3. Truncation: `horizon` steps have been made.

    ## Arguments
    - `cart_mass`: mass of the cart in kg.  Default 1.
    - `pole_mass`: mass of the pole in kg.  Default 0.1.
    - `half_length`: distance from the pivot to the pole's centre of mass in m.  Default 0.5.
    - `horizon`: steps after which an episode is truncated.  Default 100.
    - `render_mode`: None or "rgb_array".

    Raises ValueError when an argument or an action is out of range.

    ## Version History
    - v0: first version.
    """

    metadata = env_metadata(RENDER_FPS)

    def __init__(
        self,
        cart_mass: float = CART_MASS,
        pole_mass: float = POLE_MASS,
        half_length: float = HALF_LENGTH,
        horizon: int = Cartpole.horizon,
        render_mode: str | None = None,
    ) -> None:
        tasks = Cartpole.of(1, cart_mass=cart_mass, pole_mass=pole_mass, half_length=half_length)
        super().__init__(tasks, _box(), _frame, horizon, render_mode)


class CartpoleVectorEnv(TasksVectorEnv):
    """Many cartpoles in one batch; row i behaves exactly as a `CartpoleEnv` of seed + i.

    Arguments as for `CartpoleEnv`, and `num_envs`; a mass or length is a number for all rows or
    has shape (num_envs,).  Rows start anew as `TasksVectorEnv` says.
    """

    metadata = vector_metadata(RENDER_FPS)

    def __init__(
        self,
        num_envs: int = 1,
        cart_mass: ArrayLike = CART_MASS,
        pole_mass: ArrayLike = POLE_MASS,
        half_length: ArrayLike = HALF_LENGTH,
        horizon: int = Cartpole.horizon,
        render_mode: str | None = None,
    ) -> None:
        count = checked_count(num_envs)
        tasks = Cartpole.of(
            count, cart_mass=cart_mass, pole_mass=pole_mass, half_length=half_length
        )
        super().__init__(tasks, _box(), _frame, horizon, render_mode)


def _box() -> spaces.Box:
    # Twice the limits, as in Gymnasium: the observation that ends an episode lies inside too.
    high = np.array([2 * POSITION_LIMIT, np.inf, 2 * ANGLE_LIMIT, np.inf], np.float32)
    return spaces.Box(-high, high, dtype=np.float32)


def _frame(tasks: Cartpole, index: int, state: np.ndarray) -> np.ndarray:
    # matplotlib takes most of a second to import and only pictures need it.
    from vtlib.envs.draw_control import cartpole_frame

    return cartpole_frame(tasks, index, state)
