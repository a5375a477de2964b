"""Plain drawing of a rooms task."""

from matplotlib.axes import Axes
from matplotlib.patches import Wedge

from vtlab.envs.draw import framed
from vtlab.envs.rooms.tasks import DOOR_WIDTH, GOAL, GOAL_RADIUS, SIDE, Rooms


def draw_rooms(
    ax: Axes,
    tasks: Rooms,
    index: int = 0,
    *,
    wall_color: str = "black",
    start_color: str = "tab:blue",
) -> None:
    """Draw task `index` on `ax`: square, walls with their doors, start (unless random) and goal."""
    ax.add_patch(Wedge(GOAL, GOAL_RADIUS, 180, 270, color="tab:green", alpha=0.6, lw=0))
    for height, door in zip(tasks.walls.tolist(), tasks.doors[index].tolist(), strict=True):
        left, right = door - DOOR_WIDTH / 2, door + DOOR_WIDTH / 2
        ax.plot([0, left], [height, height], color=wall_color, lw=2, solid_capstyle="butt")
        ax.plot([right, SIDE], [height, height], color=wall_color, lw=2, solid_capstyle="butt")
    if not tasks.uniform_start:
        ax.plot(0, 0, "o", color=start_color, clip_on=False)
    framed(ax, SIDE, wall_color)
