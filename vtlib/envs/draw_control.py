"""Plain drawings of cartpole and mountain car: for the environments' frames and for the book."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Arc, Circle, Polygon, Rectangle
from matplotlib.transforms import Affine2D, Transform
from numpy.typing import ArrayLike

from vtlib.envs.cartpole import POSITION_LIMIT, Cartpole
from vtlib.envs.draw import picture
from vtlib.envs.mountain_car import GOAL, POSITIONS, MountainCar

# The colour-blind safe palette of the book's figures.
INK, GREY, GROUND = "#1a1a1a", "#8a8a8a", "#e6e6e6"
BODY, POLE, ARROW, FLAG = "#0072B2", "#E69F00", "#D55E00", "#009E73"

CART_WIDTH, CART_HEIGHT, CART_WHEEL = 0.6, 0.34, 0.07  # m
HILL = 0.45  # the drawn height is HILL sin(3 position), as in Gymnasium
CAR_LENGTH, CAR_HEIGHT, CAR_WHEEL = 0.16, 0.05, 0.024
ARROW_PER_SPEED = 200.0  # drawn length of an action's arrow

FONT = 11


def draw_cartpole(
    ax: Axes, tasks: Cartpole, index: int, state: ArrayLike, labels: bool = False
) -> None:
    """Draw task `index` in `state` (4,) on `ax`: track with its limits, cart and pole, in m.

    With `labels` the view closes in on the cart and names masses, half length, angle and the force
    of either action, as the thesis' Figure 6.7 does.
    """
    position, _, angle, _ = (float(value) for value in np.asarray(state))
    length = 2 * float(tasks.half_length[index])
    pivot = np.array([position, CART_WHEEL + CART_HEIGHT])
    ax.axhline(0, color=GREY, lw=1.2, zorder=0)
    _cart(ax, position)
    tip = pivot + length * _direction(angle)
    ax.plot(*np.stack([pivot, tip], 1), color=POLE, lw=6, solid_capstyle="round", zorder=3)
    ax.plot(*pivot, "o", color=INK, markersize=4, zorder=4)
    if labels:
        _label_cartpole(ax, pivot, angle, length)
        _bare(ax, (position - 1.3, position + 1.3), (-0.1, pivot[1] + 1.2 * length + 0.2))
        return
    for limit in (-POSITION_LIMIT, POSITION_LIMIT):
        ax.plot([limit, limit], [0, 0.15], color=GREY, lw=1.2, zorder=0)
    side = POSITION_LIMIT + 0.4
    _bare(ax, (-side, side), (-0.1, pivot[1] + max(length, 2.0) + 0.1))


def draw_mountain_car(
    ax: Axes, tasks: MountainCar, index: int, state: ArrayLike, labels: bool = False
) -> None:
    """Draw task `index` in `state` (2,) on `ax`: the hill sin(3 position), the car and the goal.

    With `labels` two arrows show the velocity v that the actions left and right add, of a length
    proportional to the task's speed, as the thesis' Figure 6.9 does.
    """
    position = float(np.asarray(state)[0])
    x = np.linspace(POSITIONS[0] - 0.1, POSITIONS[1] + 0.1, 400)
    ax.fill_between(x, _height(x), -1.4 * HILL, color=GROUND, lw=0, zorder=0)
    ax.plot(x, _height(x), color=GREY, lw=1.5, zorder=1)
    foot = float(_height(GOAL))
    top = foot + 0.26
    ax.plot([GOAL, GOAL], [foot, top], color=INK, lw=1.5, zorder=1)
    flag = [(GOAL, top), (GOAL, top - 0.1), (GOAL - 0.13, top - 0.05)]
    ax.add_patch(Polygon(flag, color=FLAG, lw=0))
    # Turned about the point where it stands, to the slope of the hill.
    slope = math.atan(3 * HILL * math.cos(3 * position))
    place = Affine2D().rotate(slope).translate(position, float(_height(position)))
    _car(ax, place + ax.transData)
    if labels:
        _label_mountain_car(ax, place, slope, float(tasks.speed[index]))
        ax.text(GOAL - 0.17, top - 0.05, "goal", ha="right", va="center", fontsize=FONT - 1)
    _bare(ax, (POSITIONS[0] - 0.05, POSITIONS[1] + 0.05), (-1.25 * HILL, top + 0.05))


def cartpole_frame(tasks: Cartpole, index: int, state: np.ndarray) -> np.ndarray:
    """One picture (300, 600, 3) uint8 of task `index` in `state` (4,)."""
    return picture(lambda ax: draw_cartpole(ax, tasks, index, state), (6, 3))


def mountain_car_frame(tasks: MountainCar, index: int, state: np.ndarray) -> np.ndarray:
    """One picture (400, 600, 3) uint8 of task `index` in `state` (2,)."""
    return picture(lambda ax: draw_mountain_car(ax, tasks, index, state), (6, 4))


def _cart(ax: Axes, position: float) -> None:
    corner = (position - CART_WIDTH / 2, CART_WHEEL)
    ax.add_patch(Rectangle(corner, CART_WIDTH, CART_HEIGHT, color=BODY, lw=0, zorder=2))
    for side in (-1, 1):
        centre = (position + 0.28 * side * CART_WIDTH, CART_WHEEL)
        ax.add_patch(Circle(centre, CART_WHEEL, color=INK, lw=0, zorder=2))


def _label_cartpole(ax: Axes, pivot: np.ndarray, angle: float, length: float) -> None:
    """Names of the parts; those of the pole on the side to which it leans."""
    side = 1.0 if angle >= 0 else -1.0
    along, across = _direction(angle), side * _direction(angle + math.pi / 2)
    centre = pivot + length / 2 * along
    ax.plot(*centre, "o", color=INK, markersize=4, zorder=4)
    x, y = pivot - 0.42 * CART_HEIGHT * _direction(0.0)
    ax.text(x, y, r"$m_\mathrm{cart}$", color="white", ha="center", va="center", fontsize=FONT)
    _arrow(ax, pivot + 0.13 * across, centre + 0.13 * across, INK, "<|-|>", 1.0)
    align: dict[str, Any] = {"ha": "left" if side > 0 else "right", "va": "center"}
    x, y = pivot + length / 4 * along + 0.2 * across
    ax.text(x, y, r"$l_\mathrm{pole}$", fontsize=FONT, **align)
    x, y = centre + 0.4 * across + 0.22 * _direction(0.0)
    ax.text(x + 0.04 * side, y, r"$m_\mathrm{pole}$", fontsize=FONT, **align)
    _arrow(ax, (x, y), centre + 0.05 * across, INK, "-|>", 1.0)
    _forces(ax, pivot[0])
    if abs(angle) > 0.02:
        _angle(ax, pivot, angle, length)


def _forces(ax: Axes, position: float) -> None:
    height = CART_WHEEL + CART_HEIGHT / 2
    for side, force, action in ((-1, "$-F$", "left"), (1, "$F$", "right")):
        start = position + side * (CART_WIDTH / 2 + 0.04)
        _arrow(ax, (start, height), (start + 0.6 * side, height), ARROW, "-|>", 2.0)
        middle = start + 0.28 * side
        ax.text(middle, height + 0.07, force, color=ARROW, ha="center", va="bottom", fontsize=FONT)
        ax.text(middle, height - 0.08, action, ha="center", va="top", fontsize=FONT - 2)


def _angle(ax: Axes, pivot: np.ndarray, angle: float, length: float) -> None:
    """The angle between the vertical and the pole, drawn beyond its tip."""
    radius = 1.08 * length + 0.05
    upright = np.stack([pivot, pivot + radius * _direction(0.0)], 1)
    ax.plot(*upright, color=GREY, lw=1, ls=(0, (4, 3)), zorder=1)
    # An Arc's angles count from the right, and it is drawn from the first to the second.
    first, second = sorted((90.0, 90.0 - math.degrees(angle)))
    centre = (pivot[0], pivot[1])
    ax.add_patch(Arc(centre, 2 * radius, 2 * radius, theta1=first, theta2=second, color=INK))
    x, y = pivot + (radius + 0.03) * _direction(angle / 2)
    ax.text(x, y, r"$\theta$", ha="center", va="bottom", fontsize=FONT)


def _car(ax: Axes, transform: Transform) -> None:
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


def _label_mountain_car(ax: Axes, place: Affine2D, slope: float, speed: float) -> None:
    """The velocity of either action; above the car, for the ground would cut arrows beside it."""
    height, gap, length = 0.26, 0.03, ARROW_PER_SPEED * speed
    turned: dict[str, Any] = {"rotation": math.degrees(slope), "rotation_mode": "anchor"}
    for side, action in ((-1, "left"), (1, "right")):
        ends = [(side * gap, height), (side * (gap + length), height)]
        start, end = place.transform(ends)
        _arrow(ax, start, end, ARROW, "-|>", 2.0)
        middle = side * (gap + length / 2)
        above, below = place.transform([(middle, height + 0.07), (middle, height - 0.03)])
        x, y = above
        ax.text(x, y, "$v$", color=ARROW, ha="center", va="center", fontsize=FONT)
        x, y = below
        ax.text(x, y, action, ha="center", va="top", fontsize=FONT - 2, **turned)


def _height(position: float | np.ndarray) -> np.ndarray:
    sine: np.ndarray = np.sin(3 * np.asarray(position))
    return HILL * sine


def _direction(angle: float) -> np.ndarray:
    """Unit vector at `angle` from the vertical, positive to the right."""
    return np.array([math.sin(angle), math.cos(angle)])


def _arrow(
    ax: Axes, start: Iterable[float], end: Iterable[float], color: str, style: str, width: float
) -> None:
    properties = {"arrowstyle": style, "color": color, "lw": width, "shrinkA": 0, "shrinkB": 0}
    properties["mutation_scale"] = 8 + 3 * width  # size of the head in points
    (x, y), (end_x, end_y) = start, end
    ax.annotate("", (end_x, end_y), (x, y), arrowprops=properties)


def _bare(ax: Axes, xlim: tuple[float, float], ylim: tuple[float, float]) -> None:
    """Equal scales and nothing but the drawing."""
    ax.set(xlim=xlim, ylim=ylim, aspect="equal")
    ax.set_axis_off()
