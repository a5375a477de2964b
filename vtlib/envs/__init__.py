"""The environments; importing this package registers them with Gymnasium."""

import gymnasium

from vtlib.envs.cartpole import Cartpole, CartpoleFamily
from vtlib.envs.mountain_car import MountainCar, MountainCarFamily
from vtlib.envs.rooms import Rooms, RoomsFamily

__all__ = [
    "Cartpole",
    "CartpoleFamily",
    "MountainCar",
    "MountainCarFamily",
    "Rooms",
    "RoomsFamily",
]

for _name in ("Rooms", "Cartpole", "MountainCar"):
    gymnasium.register(
        id=f"vtlib/{_name}-v0",
        entry_point=f"vtlib.envs.gym:{_name}Env",
        vector_entry_point=f"vtlib.envs.gym:{_name}VectorEnv",
    )
