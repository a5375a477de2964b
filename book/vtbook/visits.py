"""Where an agent went in the lower of two rooms: measures of reach, gathering and coverage.

Visited positions have shape (R, T, 2), those of R runs at T times.
"""

import numpy as np
from scipy.special import entr

from vtlab.envs.rooms.tasks import GOAL, GOAL_RADIUS, SIDE

WALL = SIDE / 2  # height of the one wall of two rooms
CELLS = (int(SIDE), int(WALL))  # unit cells of the lower room, across and up
NEAR_DOOR = 2.0  # a visit within this distance of the door's centre is a visit at the door


def at_goal(visited: np.ndarray) -> np.ndarray:
    """Whether each visit lies at the goal, where an episode ends."""
    return _near(visited, GOAL, GOAL_RADIUS)


def arrivals(visited: np.ndarray) -> np.ndarray:
    """How often each run (R,) arrived at the goal."""
    return np.asarray(at_goal(visited).sum(1))


def share_at_door(visited: np.ndarray, door: float) -> np.ndarray:
    """Share (R,) of the visits to the lower room that lie at the door; 0 without such a visit."""
    below = visited[..., 1] < WALL
    near = _near(visited, (door, WALL), NEAR_DOOR) & below
    return np.asarray(near.sum(1) / np.maximum(below.sum(1), 1))


def uniform_share_at_door() -> float:
    """The same share if visits were spread evenly over the lower room, the door not near a side."""
    return float(np.pi * NEAR_DOOR**2 / 2 / (SIDE * WALL))


def progress(visited: np.ndarray) -> np.ndarray:
    """Share (R,) of the moves within the upper room that lead nearer to the goal; NaN without any.

    Agents move along the axes, so nearer is by the sum of both distances.
    """
    above = visited[..., 1] >= WALL
    left = np.abs(visited - np.array(GOAL, dtype=visited.dtype)).sum(-1)
    moves = above[:, :-1] & above[:, 1:]  # the next episode begins below the wall
    nearer = moves & (left[:, 1:] < left[:, :-1])
    count = moves.sum(1)
    return np.where(count > 0, nearer.sum(1) / np.maximum(count, 1), np.nan)


def coverage(visited: np.ndarray) -> dict[str, np.ndarray]:
    """How many (R,) of the lower room's 50 unit cells were visited, in two ways, and where.

    The effective cells are the exponential of the visits' entropy over the cells, which as many
    cells, visited equally often, would have. Without a visit it is 1. Right of the middle lies a
    share of the visits, 0 without one.
    """
    edges = [np.arange(count + 1) for count in CELLS]
    lower = [run[run[:, 1] < WALL] for run in visited]
    counts = np.stack([np.histogramdd(run, edges)[0].ravel() for run in lower])
    share = counts / np.maximum(counts.sum(1, keepdims=True), 1)
    return {
        "cells visited": np.asarray((counts > 0).sum(1)),
        "effective cells": np.exp(entr(share).sum(1)),
        "visits right of the middle": share[:, share.shape[1] // 2 :].sum(1),
    }


def _near(visited: np.ndarray, place: tuple[float, float], distance: float) -> np.ndarray:
    offset = visited - np.array(place, dtype=visited.dtype)
    return np.asarray(np.square(offset).sum(-1) <= distance**2)
