"""Plain drawing of a rooms task: used by the environments' frames and by the book."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Wedge

from vtlib.envs.rooms import DOOR_WIDTH, GOAL, GOAL_RADIUS, SIDE, Rooms


def draw_rooms(
    ax: Axes,
    tasks: Rooms,
    index: int = 0,
    *,
    wall_color: str = "black",
    goal_color: str = "tab:green",
    start_color: str = "tab:blue",
) -> None:
    """Draw task `index` on `ax`: square, walls with their doors, start (unless random) and goal."""
    ax.add_patch(Wedge(GOAL, GOAL_RADIUS, 180, 270, color=goal_color, alpha=0.6, lw=0))
    for height, door in zip(tasks.walls.tolist(), tasks.doors[index].tolist(), strict=True):
        left, right = door - DOOR_WIDTH / 2, door + DOOR_WIDTH / 2
        ax.plot([0, left], [height, height], color=wall_color, lw=2, solid_capstyle="butt")
        ax.plot([right, SIDE], [height, height], color=wall_color, lw=2, solid_capstyle="butt")
    if not tasks.uniform_start:
        ax.plot(0, 0, "o", color=start_color, clip_on=False)
    ax.set(xlim=(0, SIDE), ylim=(0, SIDE), aspect="equal", xticks=[], yticks=[])
    for spine in ax.spines.values():
        spine.set(color=wall_color, linewidth=2, visible=True)


def frame(tasks: Rooms, index: int, position: np.ndarray) -> np.ndarray:
    """One picture (400, 400, 3) uint8 of task `index` with the agent at `position` (2,)."""

    def draw(ax: Axes) -> None:
        draw_rooms(ax, tasks, index)
        ax.plot(*position, "o", color="tab:red", markersize=9, clip_on=False)

    return picture(draw, (4, 4))


def picture(draw: Callable[[Axes], None], size: tuple[float, float]) -> np.ndarray:
    """What `draw` puts on axes, (height, width, 3) uint8; `size` is in 100 pixels, width first."""
    figure = Figure(figsize=size, dpi=100)
    canvas = FigureCanvasAgg(figure)
    draw(figure.add_axes((0.05, 0.05, 0.9, 0.9)))
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()
