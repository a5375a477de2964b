"""Plain drawing of a cartpole: used by the environment's pictures and by the book."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Arc, Circle, Rectangle
from numpy.typing import ArrayLike

from vtlib.envs.cartpole.tasks import POSITION_LIMIT, Cartpole
from vtlib.envs.draw import ARROW, BODY, FONT, GREY, INK, POLE, arrow, bare

CART_WIDTH, CART_HEIGHT, CART_WHEEL = 0.6, 0.34, 0.07  # m


def draw_cartpole(
    ax: Axes, tasks: Cartpole, index: int, state: ArrayLike, labels: bool = False
) -> None:
    """Draw task `index` in `state` (4,) on `ax`: track with its limits, cart and pole, in m.

    With `labels` the view closes in on the cart and names masses, half length, angle and the force
    of either action, as the thesis' Figure 6.7 does; the pole is to lean to the right.
    """
    position, _, angle, _ = (float(value) for value in np.asarray(state))
    length = 2 * float(tasks.half_length[index])
    pivot = np.array([position, CART_WHEEL + CART_HEIGHT])
    ax.axhline(0, color=GREY, lw=1.2, zorder=0)
    corner = (position - CART_WIDTH / 2, CART_WHEEL)
    ax.add_patch(Rectangle(corner, CART_WIDTH, CART_HEIGHT, color=BODY, lw=0, zorder=2))
    for side in (-0.28 * CART_WIDTH, 0.28 * CART_WIDTH):
        centre = (position + side, CART_WHEEL)
        ax.add_patch(Circle(centre, CART_WHEEL, color=INK, lw=0, zorder=2))
    tip = pivot + length * _direction(angle)
    ax.plot(*np.stack([pivot, tip], 1), color=POLE, lw=6, solid_capstyle="round", zorder=3)
    ax.plot(*pivot, "o", color=INK, markersize=4, zorder=4)
    if labels:
        _label(ax, pivot, angle, length)
        bare(ax, (position - 1.3, position + 1.3), (-0.1, pivot[1] + 1.2 * length + 0.2))
        return
    for limit in (-POSITION_LIMIT, POSITION_LIMIT):
        ax.plot([limit, limit], [0, 0.15], color=GREY, lw=1.2, zorder=0)
    side = POSITION_LIMIT + 0.4
    bare(ax, (-side, side), (-0.1, pivot[1] + max(length, 2.0) + 0.1))


def _label(ax: Axes, pivot: np.ndarray, angle: float, length: float) -> None:
    """Names of the parts, those of the pole on its right; the forces; and the angle."""
    along, across, up = (_direction(x) for x in (angle, angle + math.pi / 2, 0.0))
    centre = pivot + length / 2 * along
    ax.plot(*centre, "o", color=INK, markersize=4, zorder=4)
    arrow(ax, pivot + 0.13 * across, centre + 0.13 * across, INK, "<|-|>", 1.0)
    named = centre + 0.4 * across + 0.22 * up
    arrow(ax, named, centre + 0.05 * across, INK, width=1.0)
    _write(ax, pivot - 0.42 * CART_HEIGHT * up, r"$m_\mathrm{cart}$", color="white")
    _write(ax, pivot + length / 4 * along + 0.2 * across, r"$l_\mathrm{pole}$", ha="left")
    _write(ax, named, r"$m_\mathrm{pole}$", right=0.04, ha="left")
    for side, force, action in ((-1, "$-F$", "left"), (1, "$F$", "right")):
        x, y = pivot[0] + side * (CART_WIDTH / 2 + 0.04), pivot[1] - CART_HEIGHT / 2
        arrow(ax, (x, y), (x + 0.6 * side, y))
        middle = np.array([x + 0.28 * side, y])
        _write(ax, middle, force, above=0.07, color=ARROW, va="bottom")
        _write(ax, middle, action, above=-0.08, va="top", fontsize=FONT - 2)
    radius = 1.08 * length + 0.05
    ax.plot(*np.stack([pivot, pivot + radius * up], 1), color=GREY, lw=1, ls=(0, (4, 3)), zorder=1)
    # An Arc's angles count from the right, and it is drawn from the first to the second.
    ends = {"theta1": 90 - math.degrees(angle), "theta2": 90.0}
    ax.add_patch(Arc((pivot[0], pivot[1]), 2 * radius, 2 * radius, color=INK, **ends))
    _write(ax, pivot + (radius + 0.03) * _direction(angle / 2), r"$\theta$", va="bottom")


def _write(
    ax: Axes, at: np.ndarray, text: str, right: float = 0.0, above: float = 0.0, **properties: Any
) -> None:
    looks = {"ha": "center", "va": "center", "fontsize": FONT, **properties}
    ax.text(at[0] + right, at[1] + above, text, **looks)


def _direction(angle: float) -> np.ndarray:
    """Unit vector at `angle` from the vertical, positive to the right."""
    return np.array([math.sin(angle), math.cos(angle)])
