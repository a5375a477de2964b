"""Plain drawing of a maze."""

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.patches import Circle, Rectangle
from numpy.typing import ArrayLike

from vtlab.envs.draw import BODY, FLAG, INK, WALL, framed
from vtlab.envs.maze.geometry import REACH, SIDE
from vtlab.envs.maze.tasks import ANGLES, SENSORS, Mazes

ROBOT = 0.22  # m, the radius drawn; the robot itself is a point


def draw_maze(ax: Axes, tasks: Mazes, index: int = 0, state: ArrayLike | None = None) -> None:
    """Draw task `index` on `ax`, in m: walls, goal, and the robot in `state` (3,), if there is one.

    The rays of its sensors are green where they meet the goal, and end in a dot at a wall.
    """
    x, y = tasks.goal[index].tolist()
    ax.add_patch(Rectangle((x, y), 1, 1, color=FLAG, lw=0))
    cells = np.argwhere(tasks.walls[index].numpy())
    blocks = [Rectangle((x, y), 1, 1) for x, y in cells.tolist()]
    # Blocks have outlines, because blocks that only touch show seams.
    ax.add_collection(PatchCollection(blocks, facecolor=WALL, edgecolor=WALL, lw=1))
    if state is not None:
        pose = np.asarray(state, np.float32)
        _draw_rays(ax, tasks, index, pose)
        x, y, heading = pose.tolist()
        ax.add_patch(Circle((x, y), ROBOT, facecolor=BODY, edgecolor="white", lw=0.8, zorder=4))
        nose = x + ROBOT * np.cos(heading), y + ROBOT * np.sin(heading)
        ax.plot([x, nose[0]], [y, nose[1]], color="white", lw=2, zorder=5)
    framed(ax, SIDE, WALL)


def _draw_rays(ax: Axes, tasks: Mazes, index: int, pose: np.ndarray) -> None:
    obs = tasks.select([index]).observe(torch.from_numpy(pose[None]))[0].numpy()
    distance, flag = obs[4 : 4 + SENSORS], obs[4 + SENSORS :]
    for angle, length, goal in zip(pose[2] + ANGLES, distance, flag, strict=True):
        end = pose[:2] + length * np.array([np.cos(angle), np.sin(angle)])
        color = FLAG if goal else INK
        ax.plot(*np.stack([pose[:2], end], 1), color=color, lw=1, zorder=3)
        if length < REACH:
            ax.plot(*end, "o", color=color, markersize=3, zorder=3)
