"""What tasks, families and environments refuse, with the name of what is wrong."""

import numpy as np
import pytest
import torch

from vtlab.envs import MazeFamily, MountainCar, MountainCarFamily, Rooms, RoomsFamily
from vtlab.envs.gym import CartpoleEnv, MazeEnv, RoomsEnv


@pytest.mark.parametrize(
    ("make", "arguments", "message"),
    [
        (Rooms.from_doors, {"doors": [[5.0, 9.6]]}, r"doors must lie in \[0.5, 9.5\], got 9.6"),
        (Rooms.from_doors, {"doors": [[5.0, np.nan]]}, r"doors must lie in \[0.5, 9.5\], got nan"),
        (Rooms.from_doors, {"doors": [5.0]}, r"doors must have shape \(R, W\), got \(1,\)"),
        (RoomsFamily, {"rooms": 4}, "rooms must be a whole number from 2 to 3, got 4"),
        (RoomsFamily, {"fixed_lower": 0.0}, "fixed_lower must lie in"),
        (RoomsFamily, {"normal": (5.0, 0.0)}, "deviation in normal must be positive"),
        (RoomsFamily, {"ladder": -1}, "ladder must be a whole number from 0"),
        (RoomsFamily, {"stops": 1}, "stops must be of type bool"),
        (MazeFamily, {"names": ("north 1",)}, "one of north-east 0, .*, got 'north 1'"),
        (MazeFamily, {"names": ()}, "at least one"),
        (MountainCarFamily, {"last_reward": -1.5}, r"last_reward must lie in \[-1, 0\], got"),
        *((MountainCar.of, {"count": 2, "speed": x}, r"speed must be a number or have shape \(2,\)")
          for x in ([0.001], [0.001] * 3, [[0.001] * 2])),
        *((MountainCar, {"speed": torch.tensor([1.0, x])}, f"positive and finite, got {x:g}")
          for x in (0.0, -1.0, np.nan, np.inf)),
        (RoomsEnv, {"doors": ((5.0, 5.0), (5.0, 5.0))}, "doors must have shape"),
        (CartpoleEnv, {"half_length": [1.0, 1.0]}, "half_length must be a number or have shape"),
        (MazeEnv, {"maze": "north 1"}, "maze must be one of .*, got 'north 1'"),
    ],
)  # fmt: skip
def test_wrong_values_are_refused(make, arguments, message):
    with pytest.raises(ValueError, match=message):
        make(**arguments)
