"""Plain drawing of a cartpole."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Rectangle
from numpy.typing import ArrayLike

from vtlab.envs.cartpole.tasks import POSITION_LIMIT, Cartpole
from vtlab.envs.draw import BODY, GREY, INK, POLE, bare

CART_WIDTH, CART_HEIGHT, CART_WHEEL = 0.6, 0.34, 0.07  # m


def draw_cartpole(ax: Axes, tasks: Cartpole, index: int, state: ArrayLike) -> None:
    """Draw task `index` in `state` (4,) on `ax`: track with its limits, cart and pole, in m."""
    position, _, angle, _ = (float(value) for value in np.asarray(state))
    length = 2 * float(tasks.half_length[index])
    pivot = np.array([position, CART_WHEEL + CART_HEIGHT])
    ax.axhline(0, color=GREY, lw=1.2, zorder=0)
    corner = (position - CART_WIDTH / 2, CART_WHEEL)
    ax.add_patch(Rectangle(corner, CART_WIDTH, CART_HEIGHT, color=BODY, lw=0, zorder=2))
    for side in (-0.28 * CART_WIDTH, 0.28 * CART_WIDTH):
        centre = (position + side, CART_WHEEL)
        ax.add_patch(Circle(centre, CART_WHEEL, color=INK, lw=0, zorder=2))
    tip = pivot + length * np.array([math.sin(angle), math.cos(angle)])
    ax.plot(*np.stack([pivot, tip], 1), color=POLE, lw=6, solid_capstyle="round", zorder=3)
    ax.plot(*pivot, "o", color=INK, markersize=4, zorder=4)
    for limit in (-POSITION_LIMIT, POSITION_LIMIT):
        ax.plot([limit, limit], [0, 0.15], color=GREY, lw=1.2, zorder=0)
    side = POSITION_LIMIT + 0.4
    bare(ax, (-side, side), (-0.1, pivot[1] + max(length, 2.0) + 0.1))
