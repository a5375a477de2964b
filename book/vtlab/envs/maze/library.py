"""The twenty mazes of the thesis, from a file that a person can read."""

import functools
from pathlib import Path

import numpy as np
from attrs import frozen

FILE = Path(__file__).with_name("mazes.txt")
WALL, GOAL, COMMENT = "#", "G", ";"


@frozen(eq=False)
class Maze:
    """One maze: `walls` (10, 10) bool at [x, y], the goal's cell (x, y), both from bottom left."""

    walls: np.ndarray
    goal: tuple[int, int]


@functools.cache
def library() -> dict[str, Maze]:
    """The mazes by name, five for each corner that holds the goal.

    In the file a maze is a line with its name and ten rows, the top one first; blank lines separate
    mazes, and ';' begins a comment.
    """
    mazes = {}
    lines = FILE.read_text(encoding="utf-8").splitlines()
    text = "\n".join(line for line in lines if not line.startswith(COMMENT))
    for block in text.strip().split("\n\n"):
        name, *rows = block.splitlines()
        cells = np.array([list(row) for row in reversed(rows)]).T  # [x, y]
        x, y = np.argwhere(cells == GOAL)[0].tolist()
        mazes[name] = Maze(cells == WALL, (x, y))
    return mazes
