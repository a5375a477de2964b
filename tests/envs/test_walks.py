"""Walks: they begin where they are told, obey the dynamics, and end with the episode."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from vtlib.envs import Cartpole, Mazes
from vtlib.envs.walks import walks

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


def test_robots_of_one_maze_stay_out_of_its_walls_and_stop_at_the_goal():
    maze, rng = Mazes.of(["north-east 0"] * 20), np.random.default_rng(0)
    start = maze.start(torch.from_numpy(rng.random((20, Mazes.start_dim))))
    noise = torch.from_numpy(rng.standard_normal((Mazes.horizon, 20, Mazes.noise_dim)))

    def towards(states: Tensor) -> Tensor:
        bearing = torch.atan2(9.5 - states[:, 1], 9.5 - states[:, 0]) - states[:, 2]
        bearing = torch.remainder(bearing + torch.pi, 2 * torch.pi) - torch.pi
        return torch.where(bearing.abs() < 0.3, 0, torch.where(bearing > 0, 1, 2))

    found = walks(maze, towards, start, noise)
    assert sum(len(path) <= Mazes.horizon for path in found) > 5
    for path, first in zip(found, start.numpy(), strict=True):
        np.testing.assert_array_equal(path[0], first)
        cells = path[:, :2].astype(int)
        assert not maze.walls[0].numpy()[tuple(cells.T)].any()
        arrived = np.flatnonzero((cells == 9).all(1)).tolist()
        assert arrived == ([len(path) - 1] if len(path) <= Mazes.horizon else [])
