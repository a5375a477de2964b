"""A border that stops robots: where their moves end, and what stays as in the sliding mazes."""

import numpy as np
import pytest
import torch

from vtbook.stopping_mazes import StoppingMazeFamily, StoppingMazes
from vtlab.envs.maze import MazeFamily, Mazes
from vtlab.envs.maze.geometry import BORDER, SIDE

FREE = torch.zeros(1, SIDE, SIDE, dtype=torch.bool)
CORNER = torch.tensor([[9, 9]])


def moved(kind, position, heading, noise=(0.0, 0.0, 0.0)):
    """Where a robot in an empty maze ends that drives ahead."""
    state = torch.tensor([[*position, heading]])
    after, _, _ = kind(FREE, CORNER).step(state, torch.tensor([0]), torch.tensor([noise]))
    return after[0, :2].numpy()


@pytest.mark.parametrize("heading", [3 * np.pi / 4, np.pi, 5 * np.pi / 4])
def test_a_move_across_the_border_ends_where_it_meets_it(heading):
    start = np.array([0.2, 5.0])
    slid, stopped = (moved(kind, start, heading) for kind in (Mazes, StoppingMazes))
    aside = 0.5 * np.array([np.cos(heading), np.sin(heading)])
    along = (BORDER - start[0]) / aside[0]  # of the move, until it meets the border
    np.testing.assert_allclose(stopped, start + along * aside, atol=1e-4)
    np.testing.assert_allclose(slid, [BORDER, start[1] + aside[1]], atol=1e-4)


def test_a_robot_at_the_border_may_leave_it_but_not_pass_along_it():
    start = BORDER, 5.0
    np.testing.assert_allclose(moved(StoppingMazes, start, 0.0), [BORDER + 0.5, 5.0], atol=1e-4)
    along = np.pi / 2 + 0.1
    np.testing.assert_allclose(moved(StoppingMazes, start, along), start, atol=1e-4)
    assert moved(Mazes, start, along)[1] > 5.4


def test_moves_that_stay_within_and_tasks_that_are_drawn_are_those_of_the_sliding_mazes():
    families = MazeFamily(), StoppingMazeFamily()
    drawn = [family.sample(np.random.default_rng(1), 6) for family in families]
    assert type(drawn[1]) is StoppingMazes
    assert torch.equal(drawn[0].walls, drawn[1].walls)
    rng = np.random.default_rng(0)
    u = torch.from_numpy(rng.random((6, 4)))
    state = drawn[0].start(u)
    assert torch.equal(state, drawn[1].start(u))
    ahead = torch.zeros(6, dtype=torch.int64)
    across = 0
    for _ in range(300):
        noise = torch.from_numpy(rng.standard_normal((6, 3)))
        slid, stopped = (tasks.step(state, ahead, noise)[0] for tasks in drawn)
        turn = state[:, 2].double()
        aim = state[:, :2] + 0.5 * torch.stack([turn.cos(), turn.sin()], 1) + 0.05 * noise[:, :2]
        within = ((aim > 0.02) & (aim < SIDE - 0.02)).all(1)
        assert torch.equal(slid[within], stopped[within])
        across += int((~within).sum())
        state = slid
    assert across > 10
