"""Walks: they begin where they are told, obey the dynamics, and end with the episode."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from vtbook.walks import walks
from vtlib.envs import Cartpole

POLES = Cartpole.of(3, cart_mass=1.0, pole_mass=0.1, half_length=[0.3, 0.5, 1.0])
UPRIGHT = torch.zeros(3, 4)


def right(states: Tensor) -> Tensor:
    return torch.ones(len(states), dtype=torch.int64)


def test_a_walk_obeys_the_dynamics_and_ends_where_its_own_episode_does():
    found = walks(POLES, right, UPRIGHT, torch.zeros(100, 3, 0))
    assert len({len(path) for path in found}) > 1
    for index, path in enumerate(found):
        pole, states = POLES.select([index] * len(path)), torch.from_numpy(path)
        *_, fallen = pole.step(states, right(states), torch.zeros(len(path), 0))
        reached, _, _ = pole.step(states, right(states), torch.zeros(len(path), 0))
        np.testing.assert_array_equal(reached[:-1], path[1:])
        # the state before the last is the first that a step to the right takes over the limit
        assert fallen[:-1].nonzero().flatten().tolist() == [len(path) - 2]


def test_a_walk_is_no_longer_than_its_noise():
    for steps in (0, 4):
        found = walks(POLES, right, UPRIGHT, torch.zeros(steps, 3, 0))
        assert [path.shape for path in found] == [(steps + 1, 4)] * 3
