"""Plain drawing of a rooms task: used by the environment's pictures and by the book."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Wedge
from numpy.typing import ArrayLike

from vtlab.envs.draw import framed
from vtlab.envs.rooms.tasks import DOOR_WIDTH, GOAL, GOAL_RADIUS, SIDE, Rooms


def draw_rooms(
    ax: Axes,
    tasks: Rooms,
    index: int = 0,
    state: ArrayLike | None = None,
    *,
    wall_color: str = "black",
    start_color: str = "tab:blue",
) -> None:
    """Draw task `index` on `ax`: square, walls with their doors, start (unless random) and goal.

    With a `state` (2,) the agent stands there.
    """
    ax.add_patch(Wedge(GOAL, GOAL_RADIUS, 180, 270, color="tab:green", alpha=0.6, lw=0))
    for height, door in zip(tasks.walls.tolist(), tasks.doors[index].tolist(), strict=True):
        left, right = door - DOOR_WIDTH / 2, door + DOOR_WIDTH / 2
        ax.plot([0, left], [height, height], color=wall_color, lw=2, solid_capstyle="butt")
        ax.plot([right, SIDE], [height, height], color=wall_color, lw=2, solid_capstyle="butt")
    if not tasks.uniform_start:
        ax.plot(0, 0, "o", color=start_color, clip_on=False)
    framed(ax, SIDE, wall_color)
    if state is not None:
        ax.plot(*np.asarray(state), "o", color="tab:red", markersize=9, clip_on=False)
