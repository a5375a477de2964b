"""Mazes as text that a person can read and edit, and the twenty that come with the library."""

import functools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import scipy
from attrs import frozen

from vtlab.envs.maze.geometry import SIDE
from vtlib.checks import check_kind, check_one_of, one_line

FILE = Path(__file__).with_name("mazes.txt")
WALL, FREE, GOAL, COMMENT = "#", ".", "G", ";"


@frozen(eq=False)
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
    cells = np.array([list(row) for row in reversed(rows) if len(row) == SIDE]).T  # [x, y]
    if (fault := next(_faults(rows, cells), None)) is not None:
        raise ValueError(one_line(f"{name}: {fault}"))
    x, y = np.argwhere(cells == GOAL)[0].tolist()
    return Maze(name, cells == WALL, (x, y))


def load_mazes(path: Path | str) -> dict[str, Maze]:
    """The mazes of a text file by their names, in its order.

    A maze is a line with its name and ten rows as for `parse_maze`; blank lines separate mazes, and
    ';' begins a comment. Raises ValueError with one line that gives the maze and its first fault.
    """
    file = one_line(Path(path).name)
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise ValueError(f"{file}: it is not text in UTF-8 ({error.reason})") from None
    text = "\n".join(line.strip() for line in lines if not line.lstrip().startswith(COMMENT))
    mazes: dict[str, Maze] = {}
    for block in filter(None, (block.strip() for block in text.split("\n\n"))):
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
    """A maze of the library. Raises ValueError when there is none of that name."""
    check_one_of("maze", name, library())
    return library()[name]


def _faults(rows: list[str], cells: np.ndarray) -> Iterator[str]:
    """What is wrong with a drawing; only the first fault is to be asked for."""
    if len(rows) != SIDE:
        yield f"there are {len(rows)} rows, not {SIDE}"
    for number, row in enumerate(rows, 1):
        if len(row) != SIDE:
            yield f"row {number} has {len(row)} cells, not {SIDE}"
        if unknown := set(row) - {WALL, FREE, GOAL}:
            yield f"row {number} has {min(unknown)!r}, which is none of {WALL} {FREE} {GOAL}"
    free, reached = cells != WALL, cells == GOAL
    if reached.sum() != 1:
        yield f"there are {reached.sum()} cells {GOAL}, not 1"
    x, y = np.argwhere(reached)[0]
    if not {x, y} <= {0, SIDE - 1}:
        yield f"the goal, in row {SIDE - y}, column {x + 1}, is not in a corner"
    if free.sum() == 1:
        yield "there is no free cell to start from"
    part, _ = scipy.ndimage.label(free)  # of cells that are connected through their sides
    if (cut_off := np.argwhere(free & (part != part[x, y]))).size:
        x, y = max(cut_off.tolist(), key=lambda cell: (cell[1], -cell[0]))
        yield f"no way leads to the goal from row {SIDE - y}, column {x + 1}"
