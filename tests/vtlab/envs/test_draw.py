"""The drawings: parts in their places."""

import math

import numpy as np
import pytest
import torch
from matplotlib.figure import Figure

from vtlab.envs import Cartpole, Mazes, Rooms
from vtlab.envs.cartpole.draw import draw_cartpole
from vtlab.envs.draw import FLAG, INK, POLE
from vtlab.envs.maze.draw import draw_maze
from vtlab.envs.rooms.draw import draw_rooms


def drawn(draw, *arguments):
    ax = Figure().add_axes((0, 0, 1, 1))
    draw(ax, *arguments)
    return ax


def test_the_drawing_of_rooms_leaves_the_doors_open():
    ax = drawn(draw_rooms, Rooms.from_doors([[5.0, 5.0], [2.0, 7.0]]), 1)
    walls = [line.get_xydata().tolist() for line in ax.lines if len(line.get_xdata()) == 2]
    gaps = [(left[1][0], right[0][0]) for left, right in zip(walls[::2], walls[1::2], strict=True)]
    assert gaps == [(1.5, 2.5), (6.5, 7.5)]


def test_a_pole_has_its_length_and_angle():
    poles = Cartpole.of(2, cart_mass=1.0, pole_mass=0.1, half_length=[0.5, 1.0])
    ax = drawn(draw_cartpole, poles, 1, [-1.0, 0, 0.03, 0])
    (pole,) = [line for line in ax.lines if line.get_color() == POLE]
    x, y = np.diff(pole.get_xydata(), axis=0)[0]
    assert (np.hypot(x, y), np.arctan2(x, y)) == pytest.approx((2.0, 0.03))
    assert pole.get_xydata()[0, 0] == -1.0


def test_the_rays_of_a_robot_end_where_they_read():
    state = [0.5, 2.5, -math.pi / 2]
    maze = Mazes.of(["south-west 14"])
    ax = drawn(draw_maze, maze, 0, state)
    lengths, flags = maze.observe(torch.tensor([state]))[0, 4:].view(2, 9)
    lines = [line for line in ax.lines if line.get_color() in (INK, FLAG)]
    rays = [line for line in lines if len(line.get_xdata()) == 2]
    ends = np.array([ray.get_xydata() for ray in rays])
    np.testing.assert_allclose(np.hypot(*(ends[:, 1] - ends[:, 0]).T), lengths, atol=1e-5)
    assert [ray.get_color() for ray in rays] == [FLAG if flag else INK for flag in flags]
    assert flags.unique().numel() == 2
    assert len(lines) - len(rays) == int((lengths < 2).sum())
