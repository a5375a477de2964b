"""The Gymnasium environments, single and vectorised, in one place."""

from vtlib.envs.cartpole_env import CartpoleEnv, CartpoleVectorEnv
from vtlib.envs.maze_env import MazeEnv, MazeVectorEnv
from vtlib.envs.mountain_car_env import MountainCarEnv, MountainCarVectorEnv
from vtlib.envs.rooms_env import RoomsEnv, RoomsVectorEnv

__all__ = [
    "CartpoleEnv",
    "CartpoleVectorEnv",
    "MazeEnv",
    "MazeVectorEnv",
    "MountainCarEnv",
    "MountainCarVectorEnv",
    "RoomsEnv",
    "RoomsVectorEnv",
]
