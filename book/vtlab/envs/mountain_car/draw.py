"""Plain drawing of the mountain car."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon
from matplotlib.transforms import Affine2D, Transform
from numpy.typing import ArrayLike

from vtlab.envs.draw import BODY, FLAG, GREY, GROUND, INK, bare
from vtlab.envs.mountain_car.tasks import GOAL, POSITIONS, MountainCar

HILL = 0.45  # the drawn height is HILL sin(3 position), as in Gymnasium
CAR_LENGTH, CAR_HEIGHT, CAR_WHEEL = 0.16, 0.05, 0.024


def draw_mountain_car(ax: Axes, tasks: MountainCar, index: int, state: ArrayLike) -> None:
    """Draw the `state` (2,) of any task on `ax`: the hill sin(3 position), the car and the goal."""
    position = float(np.asarray(state)[0])
    x = np.linspace(POSITIONS[0] - 0.1, POSITIONS[1] + 0.1, 400)
    ax.fill_between(x, _height(x), -1.4 * HILL, color=GROUND, lw=0, zorder=0)
    ax.plot(x, _height(x), color=GREY, lw=1.5, zorder=1)
    foot = float(_height(GOAL))
    top = foot + 0.26
    ax.plot([GOAL, GOAL], [foot, top], color=INK, lw=1.5, zorder=1)
    flag = [(GOAL, top), (GOAL, top - 0.1), (GOAL - 0.13, top - 0.05)]
    ax.add_patch(Polygon(flag, color=FLAG, lw=0))
    # The car is turned about the point where it stands, to the slope of the hill.
    slope = math.atan(3 * HILL * math.cos(3 * position))
    place = Affine2D().rotate(slope).translate(position, float(_height(position)))
    _draw_car(ax, place + ax.transData)
    bare(ax, (POSITIONS[0] - 0.05, POSITIONS[1] + 0.05), (-1.25 * HILL, top + 0.05))


def _draw_car(ax: Axes, transform: Transform) -> None:
    """A car that drives to the right, standing on the origin of `transform`."""
    half, floor = CAR_LENGTH / 2, CAR_WHEEL
    hood, roof = floor + CAR_HEIGHT, floor + 1.8 * CAR_HEIGHT
    outline = [(-half, floor), (half, floor), (half, hood), (0.45 * half, hood)]
    outline += [(0.15 * half, roof), (-0.5 * half, roof), (-0.75 * half, hood), (-half, hood)]
    ax.add_patch(Polygon(outline, color=BODY, lw=0, transform=transform, zorder=3))
    for side in (-1, 1):
        wheel = Circle((0.58 * side * half, floor), CAR_WHEEL, color=INK, lw=0)
        wheel.set(transform=transform, zorder=4)
        ax.add_patch(wheel)


def _height(position: float | np.ndarray) -> np.ndarray:
    sine: np.ndarray = np.sin(3 * np.asarray(position))
    return HILL * sine
