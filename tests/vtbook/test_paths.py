"""Walks: they begin where they are told, obey the dynamics, and end with the episode."""

import numpy as np
import torch

from vtbook.paths import walks
from vtlab.envs import Cartpole

POLES = Cartpole.of(3, cart_mass=1.0, pole_mass=0.1, half_length=[0.3, 0.5, 1.0])


def right(states: torch.Tensor) -> torch.Tensor:
    return torch.ones(len(states), dtype=torch.int64)


def test_a_walk_obeys_the_dynamics_and_ends_with_its_own_episode_or_its_noise():
    found, at_first, short = (
        walks(POLES, right, torch.zeros(3, 4), torch.zeros(steps, 3, 0)) for steps in (100, 0, 4)
    )
    assert len({len(path) for path in found}) > 1
    for index, path in enumerate(found):
        pole, states = POLES.select([index] * len(path)), torch.from_numpy(path)
        reached, _, fallen = pole.step(states, right(states), torch.zeros(len(path), 0))
        np.testing.assert_array_equal(reached[:-1], path[1:])
        # the state before the last is the first that a step to the right takes over the limit
        assert fallen[:-1].nonzero().flatten().tolist() == [len(path) - 2]
        np.testing.assert_array_equal(at_first[index], np.zeros((1, 4)))
        np.testing.assert_array_equal(short[index], path[:5])
