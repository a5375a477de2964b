"""The environments; importing this package registers them with Gymnasium."""

import gymnasium

from vtlib.envs.cartpole import Cartpole, CartpoleFamily
from vtlib.envs.maze import MazeFamily, Mazes
from vtlib.envs.mazes import load_mazes, parse_maze
from vtlib.envs.mountain_car import MountainCar, MountainCarFamily
from vtlib.envs.rooms import Rooms, RoomsFamily

__all__ = [
    "Cartpole",
    "CartpoleFamily",
    "MazeFamily",
    "Mazes",
    "MountainCar",
    "MountainCarFamily",
    "Rooms",
    "RoomsFamily",
    "load_mazes",
    "parse_maze",
]

for _name in ("Rooms", "Cartpole", "MountainCar", "Maze"):
    gymnasium.register(
        id=f"vtlib/{_name}-v0",
        entry_point=f"vtlib.envs.gym:{_name}Env",
        vector_entry_point=f"vtlib.envs.gym:{_name}VectorEnv",
    )
