"""Mazes as text: the twenty of the library, one's own, and what is said of a wrong one."""

import numpy as np
import pytest
import torch

from vtlab.envs import Mazes, load_mazes
from vtlab.envs.maze.library import library, named

CORNERS = {"north-east": (9, 9), "north-west": (0, 9), "south-west": (0, 0), "south-east": (9, 0)}
DRAWING = "\n#........G\n#.########\n" + "#.........\n" * 8
NO_WAY = "no way leads to the goal from"


def changed(row: int, text: str) -> str:
    """The drawing, named "mine", with another row."""
    rows = DRAWING.strip().splitlines()
    rows[row] = text
    return "\n".join(["mine", *rows])


def test_the_library_holds_five_mazes_for_each_corner():
    corners = [corner for corner in CORNERS for _ in range(5)]
    assert list(library()) == [f"{corner} {number}" for number, corner in enumerate(corners)]
    for name, maze in library().items():
        assert (maze.name, maze.goal) == (name, CORNERS[name.split()[0]])
        assert named(name) is maze
    # the second row of the first published maze
    assert np.flatnonzero(named("north-east 0").walls[:, 8]).tolist() == [1]


def test_ones_own_mazes_become_tasks_beside_the_librarys(tmp_path):
    path = tmp_path / "own.txt"
    second = changed(0, "G.........")
    path.write_text(f"; My mazes.\n\nfirst\n{DRAWING.strip()}\n  \n\n {second} \r\n; G below\n  \n")
    own = load_mazes(path)
    expected = [("first", "first", (9, 9)), ("mine", "mine", (0, 9))]
    assert [(name, maze.name, maze.goal) for name, maze in own.items()] == expected
    # [x, y] from the bottom left, the first row on top
    drawn = [[cell == "#" for cell in row] for row in reversed(DRAWING.split())]
    np.testing.assert_array_equal(own["first"].walls.T, drawn)
    tasks = Mazes.of([own["mine"], "south-west 10", own["first"]])
    assert tasks.goal.tolist() == [[0, 9], [0, 0], [9, 9]]
    assert torch.equal(tasks.walls[2], torch.from_numpy(own["first"].walls))
    assert load_mazes(str(path)).keys() == own.keys()


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("mine", "mine: there are 0 rows, not 10"),
        (changed(2, "..........\n.........."), "mine: there are 11 rows, not 10"),
        (changed(2, "........."), "mine: row 3 has 9 cells, not 10"),
        (changed(2, ".... ....."), "mine: row 3 has ' ', which is none of # . G"),
        (changed(0, "#........."), "mine: there are 0 cells G, not 1"),
        (changed(2, "G........."), "mine: there are 2 cells G, not 1"),
        (changed(0, "#.......G."), "mine: the goal, in row 1, column 9, is not in a corner"),
        (changed(1, "#" * 10), f"mine: {NO_WAY} row 3, column 2"),
        ("mine\n#########G" + "\n##########" * 9, "mine: there is no free cell to start from"),
        ("mine\nG........#" + "\n#########." * 9, f"mine: {NO_WAY} row 2, column 10"),
        ("", "own.txt: there is no maze in it"),
        (DRAWING, "own.txt: the maze that begins with #........G has no name"),
        (f"a{DRAWING}\na{DRAWING}", "own.txt: two mazes are called a"),
    ],
)
def test_a_wrong_drawing_or_file_gets_one_line(tmp_path, text, fault):
    path = tmp_path / "own.txt"
    path.write_text(text)
    with pytest.raises(ValueError) as caught:
        load_mazes(path)
    assert str(caught.value) == fault
