"""The twenty mazes of the library."""

import numpy as np
import scipy

from vtlab.envs.maze.library import library

CORNERS = {"north-east": (9, 9), "north-west": (0, 9), "south-west": (0, 0), "south-east": (9, 0)}


def test_the_library_holds_five_mazes_for_each_corner_and_each_free_cell_leads_to_the_goal():
    corners = [corner for corner in CORNERS for _ in range(5)]
    assert list(library()) == [f"{corner} {number}" for number, corner in enumerate(corners)]
    for name, maze in library().items():
        assert maze.goal == CORNERS[name.split()[0]]
        part, count = scipy.ndimage.label(~maze.walls)  # cells that are connected by their sides
        assert (count, part[maze.goal]) == (1, 1), name
    # the second row of the first published maze
    assert np.flatnonzero(library()["north-east 0"].walls[:, 8]).tolist() == [1]
