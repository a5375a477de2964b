"""The environments; importing this package registers them with Gymnasium."""

import gymnasium

from vtlib.envs.rooms import Rooms, RoomsFamily

__all__ = ["Rooms", "RoomsFamily"]

gymnasium.register(
    id="vtlib/Rooms-v0",
    entry_point="vtlib.envs.gym:RoomsEnv",
    vector_entry_point="vtlib.envs.gym:RoomsVectorEnv",
)
