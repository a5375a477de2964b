"""Where an agent went in the lower of two rooms: measures of reach, gathering and coverage."""

from __future__ import annotations

import numpy as np

from vtlib.envs.rooms import GOAL, GOAL_RADIUS, SIDE

WALL = SIDE / 2  # height of the one wall of two rooms
CELLS = (int(SIDE), int(WALL))  # unit cells of the lower room, across and up
NEAR_DOOR = 2.0  # a visit within this distance of the door's centre is a visit at the door


def arrivals(visited: np.ndarray) -> np.ndarray:
    """How often each run (R,) arrived at the goal, from visited positions (R, T, 2)."""
    offset = visited - np.array(GOAL, dtype=visited.dtype)
    counts: np.ndarray = (np.square(offset).sum(-1) <= GOAL_RADIUS**2).sum(1)
    return counts


def share_at_door(visited: np.ndarray, door: float) -> np.ndarray:
    """Share (R,) of the visits to the lower room that lie at the door."""
    below = visited[..., 1] < WALL
    offset = visited - np.array([door, WALL], dtype=visited.dtype)
    near = np.square(offset).sum(-1) <= NEAR_DOOR**2
    share: np.ndarray = (near & below).sum(1) / np.maximum(below.sum(1), 1)
    return share


def uniform_share_at_door() -> float:
    """The same share if visits were spread evenly over the lower room, the door not near a side."""
    return float(np.pi * NEAR_DOOR**2 / 2 / (SIDE * WALL))


def cell_counts(visited: np.ndarray) -> np.ndarray:
    """Visits (R, 10, 5) to each unit cell of the lower room."""
    across, up = (np.floor(visited[..., i]).astype(int).clip(0, int(SIDE) - 1) for i in (0, 1))
    counts = np.zeros((len(visited), *CELLS), dtype=np.int64)
    run = np.broadcast_to(np.arange(len(visited))[:, None], across.shape)
    below = visited[..., 1] < WALL
    np.add.at(counts, (run[below], across[below], up[below]), 1)
    return counts


def cells_visited(visited: np.ndarray) -> np.ndarray:
    """How many (R,) of the lower room's 50 unit cells were visited at least once."""
    cells: np.ndarray = (cell_counts(visited) > 0).sum((1, 2))
    return cells


def effective_cells(visited: np.ndarray) -> np.ndarray:
    """Exponential (R,) of the entropy of the visits over the lower room's unit cells.

    As many cells, visited equally often, would have the same entropy. Without a visit it is 1.
    """
    counts = cell_counts(visited).reshape(len(visited), -1)
    share = counts / np.maximum(counts.sum(1, keepdims=True), 1)
    logarithm = np.log(share, out=np.zeros_like(share), where=share > 0)
    cells: np.ndarray = np.exp(-(share * logarithm).sum(1))
    return cells
