"""Mazes as text that a person can read and edit, and the twenty that come with the library."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vtlib.checks import check_kind, one_line, shown
from vtlib.envs.maze_geometry import SIDE

FILE = Path(__file__).with_name("mazes.txt")
WALL, FREE, GOAL, COMMENT = "#", ".", "G", ";"


@dataclass(frozen=True, eq=False)
class Maze:
    """One maze: `walls` (10, 10) bool at [x, y], the goal's cell (x, y), both from bottom left."""

    name: str
    walls: np.ndarray
    goal: tuple[int, int]


def parse_maze(text: str, name: str = "maze") -> Maze:
    """The maze drawn as ten rows of ten cells, the top one first: '#' wall, '.' free, 'G' goal.

    The goal is in a corner, and every free cell is connected with it through sides of cells.
    Raises ValueError with one line that gives the name and the first fault.
    """
    check_kind("text", text, str)
    rows = [row.strip() for row in text.strip().splitlines()]
    fault = _fault_of_shape(rows)
    if fault is None:
        cells = np.array([list(row) for row in reversed(rows)]).T
        fault = _fault_of_cells(cells)
    if fault is not None:
        raise ValueError(one_line(f"{name}: {fault}"))
    x, y = (int(i) for i in np.argwhere(cells == GOAL)[0])
    return Maze(name, cells == WALL, (x, y))


def load_mazes(path: Path | str) -> dict[str, Maze]:
    """The mazes of a text file by their names, in its order.

    A maze is a line with its name and ten rows as `parse_maze` reads them; blank lines stand
    between mazes, and lines that begin with ';' are comments.  Raises ValueError with one line that
    gives the maze and its first fault.
    """
    file = one_line(Path(path).name)
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise ValueError(f"{file}: it is not text in UTF-8 ({error.reason})") from None
    kept = "\n".join(line.strip() for line in lines if not line.lstrip().startswith(COMMENT))
    mazes: dict[str, Maze] = {}
    for block in filter(None, (block.strip() for block in kept.split("\n\n"))):
        name, _, rows = block.partition("\n")
        if set(name) <= {WALL, FREE, GOAL}:
            raise ValueError(f"{file}: the maze that begins with {name} has no name")
        if name in mazes:
            raise ValueError(f"{file}: two mazes are called {one_line(name)}")
        mazes[name] = parse_maze(rows, name)
    if not mazes:
        raise ValueError(f"{file}: there is no maze in it")
    return mazes


@functools.cache
def library() -> dict[str, Maze]:
    """The twenty mazes of this library by name, five for each corner that holds the goal."""
    return load_mazes(FILE)


def named(name: str) -> Maze:
    """A maze of the library.  Raises ValueError when there is none of that name."""
    if name not in library():
        raise ValueError(f"there is no maze {shown(name)}; there are {', '.join(library())}")
    return library()[name]


def _fault_of_shape(rows: list[str]) -> str | None:
    if len(rows) != SIDE:
        return f"there are {len(rows)} rows, not {SIDE}"
    for number, row in enumerate(rows, 1):
        if len(row) != SIDE:
            return f"row {number} has {len(row)} cells, not {SIDE}"
        if unknown := set(row) - {WALL, FREE, GOAL}:
            return f"row {number} has {min(unknown)!r}, which is none of {WALL} {FREE} {GOAL}"
    return None


def _fault_of_cells(cells: np.ndarray) -> str | None:
    """What is wrong with cells [x, y], those of the lowest row at y = 0."""
    goals = np.argwhere(cells == GOAL)
    if len(goals) != 1:
        return f"there are {len(goals)} cells {GOAL}, not 1"
    if not np.isin(goals[0], (0, SIDE - 1)).all():
        x, y = goals[0]
        return f"the goal, in row {SIDE - y}, column {x + 1}, is not in a corner"
    free = cells != WALL
    if free.sum() == 1:
        return "there is no free cell to start from"
    cut_off = np.argwhere(free & ~_connected(free, cells == GOAL))
    if len(cut_off):
        x, y = max(cut_off.tolist(), key=lambda cell: (cell[1], -cell[0]))
        return f"no way leads to the goal from row {SIDE - y}, column {x + 1}"
    return None


def _connected(free: np.ndarray, reached: np.ndarray) -> np.ndarray:
    """Free cells (10, 10) that are connected with those reached through sides of free cells."""
    while True:
        wider = reached.copy()
        wider[1:] |= reached[:-1]
        wider[:-1] |= reached[1:]
        wider[:, 1:] |= reached[:, :-1]
        wider[:, :-1] |= reached[:, 1:]
        wider &= free
        if (wider == reached).all():
            return reached
        reached = wider
