"""The environments; importing this package registers them with Gymnasium."""

import gymnasium

from vtlib.envs.cartpole import Cartpole, CartpoleFamily
from vtlib.envs.maze import MazeFamily, Mazes, load_mazes, parse_maze
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

_PACKAGES = {
    "Rooms": ("rooms", Rooms.horizon),
    "Cartpole": ("cartpole", Cartpole.horizon),
    "MountainCar": ("mountain_car", MountainCar.horizon),
    "Maze": ("maze", Mazes.horizon),
}
for _name, (_package, _horizon) in _PACKAGES.items():
    gymnasium.register(
        f"vtlib/{_name}-v0",
        f"vtlib.envs.{_package}.gym:{_name}Env",
        max_episode_steps=_horizon,
    )
