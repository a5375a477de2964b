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

for _name, _horizon in (
    ("Rooms", Rooms.horizon),
    ("Cartpole", Cartpole.horizon),
    ("MountainCar", MountainCar.horizon),
    ("Maze", Mazes.horizon),
):
    _entry = f"vtlab.envs.gym:{_name}Env"
    gymnasium.register(f"vtlab/{_name}-v0", _entry, max_episode_steps=_horizon)
