"""Tasks of the laboratory as Gymnasium environments, one task each."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import ArrayLike
from torch import Tensor

from vtlab.envs.cartpole.tasks import ANGLE_LIMIT, POSITION_LIMIT, Cartpole
from vtlab.envs.maze import geometry
from vtlab.envs.maze.tasks import SENSORS, Mazes
from vtlab.envs.mountain_car.tasks import MAX_SPEED, POSITIONS, MountainCar
from vtlab.envs.rooms.tasks import SIDE, Rooms


class TasksEnv(gymnasium.Env[np.ndarray, np.int64]):
    """The only task of a batch as an environment; subclasses hold arguments, bounds and words.

    Observations lie between `low` and `high`. Gymnasium's `make` truncates its episodes and sees to
    it that they begin with a reset. The subclasses raise ValueError when an argument is out of
    range.
    """

    def __init__(self, tasks: Any, low: ArrayLike, high: ArrayLike) -> None:
        self.tasks, self.action_space = tasks, spaces.Discrete(tasks.n_actions)
        ends = np.array(low, np.float32), np.array(high, np.float32)
        self.observation_space = spaces.Box(*ends)
        self._state = torch.empty(0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode: observation (obs_dim,) float32 and an empty info; no options known."""
        super().reset(seed=seed)
        u = self.np_random.random((1, self.tasks.start_dim), np.float32)
        self._state = self.tasks.start(torch.from_numpy(u))
        return self._observation(), {}

    def step(self, action: np.int64) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Act once. Raises ValueError for an unknown action."""
        if not self.action_space.contains(action):
            last = self.tasks.n_actions - 1
            raise ValueError(f"action must be an integer in 0..{last}, got {action!r}")
        noise = self.np_random.standard_normal((1, self.tasks.noise_dim), np.float32)
        self._state, reward, terminated = self.tasks.step(
            self._state, torch.tensor([int(action)]), torch.from_numpy(noise)
        )
        return self._observation(), float(reward), bool(terminated), False, {}

    def _observation(self) -> np.ndarray:
        # A copy, because the caller may change it, and an observation may be the state itself.
        obs: Tensor = self.tasks.observe(self._state)[0]
        return obs.numpy().copy()


class RoomsEnv(TasksEnv):
    """A square cut into rooms by walls with doors, to be crossed to its far corner.

    Observations are the position x, y in a square of 10 x 10. Actions are 0 for up, 1 for right, 2
    for down and 3 for left. Reaching the corner earns 1 and ends the episode. ``doors`` are their
    centres in [0.5, 9.5], lowest wall first; ``uniform_start`` starts anywhere in the square, not
    at (0, 0). Source: thesis section 6.1.
    """

    def __init__(self, doors: Sequence[float] = (5.0, 5.0), uniform_start: bool = False) -> None:
        super().__init__(Rooms.from_doors([doors], uniform_start), (0, 0), (SIDE, SIDE))


class CartpoleEnv(TasksEnv):
    """A pole on a cart, to be kept upright by pushing the cart left and right.

    Observations are the cart's position (m) and velocity (m/s), the pole's angle (rad, 0 upright
    and positive to the right) and angular velocity (rad/s). Actions are 0 for left and 1 for right.
    Each step earns 1, until the pole leans by more than 12 degrees or the cart is more than 2.4 m
    from the middle. Masses are in kg; ``half_length`` is from the pivot to the pole's centre of
    mass, in m. Source: thesis section 6.2.1. By default it is Gymnasium's CartPole-v1.
    """

    def __init__(
        self, cart_mass: float = 1.0, pole_mass: float = 0.1, half_length: float = 0.5
    ) -> None:
        tasks = Cartpole.of(1, cart_mass=cart_mass, pole_mass=pole_mass, half_length=half_length)
        # The space has twice the limits, as in Gymnasium, so that last observations lie inside.
        high = np.array([2 * POSITION_LIMIT, np.inf, 2 * ANGLE_LIMIT, np.inf])
        super().__init__(tasks, -high, high)


class MountainCarEnv(TasksEnv):
    """A car in a valley, too weak to climb out without swinging to and fro.

    Observations are position and velocity. Actions are 0 for left, 1 for none and 2 for right, and
    add -``speed``, 0 or ``speed`` to the velocity. Each step earns -1, but 0 the one that reaches
    the goal, where the episode ends, unlike Gymnasium's. Source: thesis section 6.2.2. By default
    the engine is as strong as in Gymnasium's MountainCar-v0.
    """

    def __init__(self, speed: float = 0.001) -> None:
        low, high = zip(POSITIONS, (-MAX_SPEED, MAX_SPEED), strict=True)
        super().__init__(MountainCar.of(1, speed=speed), low, high)


class MazeEnv(TasksEnv):
    """A robot with nine distance sensors in a maze, to be driven to the goal in a corner.

    Observations are the position x, y (m), cosine and sine of the heading, the distance to a wall
    along each ray (m, at most 2), and for each ray whether it meets the goal. Rays are -90, -67.5,
    ..., 90 degrees from the heading. Actions are 0 for 0.5 m ahead, 1 for a turn by 22.5 degrees to
    the left and 2 for one to the right. Reaching the goal's cell earns 1 and ends the episode.
    ``maze`` is a name in `vtlab.envs.maze.library`. Source: thesis section 6.3.
    """

    def __init__(self, maze: str = "north-east 0") -> None:
        low = [0, 0, -1, -1, *[0] * 2 * SENSORS]
        side, reach = geometry.SIDE, geometry.REACH
        high = [side, side, 1, 1, *[reach] * SENSORS, *[1] * SENSORS]
        super().__init__(Mazes.of([maze]), low, high)
