"""The environments; importing this package registers them with Gymnasium."""

import gymnasium

from vtlab.envs.cartpole import Cartpole, CartpoleFamily
from vtlab.envs.maze import MazeFamily, Mazes
from vtlab.envs.mountain_car import MountainCar, MountainCarFamily
from vtlab.envs.rooms import Rooms, RoomsFamily

__all__ = [
    "Cartpole",
    "CartpoleFamily",
    "MazeFamily",
    "Mazes",
    "MountainCar",
    "MountainCarFamily",
    "Rooms",
    "RoomsFamily",
]

for _name, _package, _horizon in (
    ("Rooms", "rooms", Rooms.horizon),
    ("Cartpole", "cartpole", Cartpole.horizon),
    ("MountainCar", "mountain_car", MountainCar.horizon),
    ("Maze", "maze", Mazes.horizon),
):
    _entry = f"vtlab.envs.{_package}.gym:{_name}Env"
    gymnasium.register(f"vtlab/{_name}-v0", _entry, max_episode_steps=_horizon)
