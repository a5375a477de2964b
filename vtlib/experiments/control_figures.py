"""The diagrams of the classic control pages, drawn from the environments."""

from __future__ import annotations

import torch
from matplotlib.figure import Figure

from vtlib.envs.cartpole import Cartpole
from vtlib.envs.draw_control import draw_cartpole, draw_mountain_car
from vtlib.envs.mountain_car import MountainCar
from vtlib.plots import BookFigure


def cartpole_diagram() -> Figure:
    """One cartpole with its parameters and force named."""
    task = Cartpole(*(torch.tensor([x]) for x in (1.0, 0.1, 0.5)))
    figure = BookFigure(figsize=(3.6, 2.9), layout="constrained")
    draw_cartpole(figure.subplots(), task, 0, torch.tensor([0.0, 0.0, 0.2, 0.0]), labels=True)
    return figure


def mountain_car_diagram() -> Figure:
    """The hill, the car and the velocities of its actions."""
    figure = BookFigure(figsize=(3.6, 2.6), layout="constrained")
    task = MountainCar(torch.tensor([0.001]))
    draw_mountain_car(figure.subplots(), task, 0, torch.tensor([-0.5, 0.0]), labels=True)
    return figure
