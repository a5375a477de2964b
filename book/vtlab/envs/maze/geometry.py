"""Where straight lines meet the walls of mazes, for a batch of mazes of unit cells at once.

The cell behind each of the few grid lines that a line can cross is looked up, for both axes along a
dimension of length two. NumPy takes a third of torch's time for small arrays. In float64 rounding
does not decide what a ray sees that passes close by a corner.
"""

from __future__ import annotations

import math

import numpy as np
from attrs import frozen

SIDE = 10  # cells, each 1 m wide
REACH = 2.0  # m that the sensors see
# Walls are this much wider (m) for the robot's centre. So it never touches one, however float32
# rounds its position, and never slips between two that touch only at a corner.
CLEARANCE = 0.01
LONGEST_MOVE = 0.95  # m along either axis: such a move meets at most one line of each kind
# The border is a hair wider (m), or a robot that slides along it would touch it.
BORDER = CLEARANCE + 1e-5
# A blocked move ends earlier by this share of it, so that a robot that has run into a wall head-on
# can still drive along it.
BACK_OFF = 2e-4

PADDING = 2  # cells of wall around the square, as far as a ray or a move can reach beyond it
WIDTH = SIDE + 2 * PADDING
# Contents of cells. The larger of a distance and WALL is the distance; the larger of a distance
# and anything else is at least REACH.  The same holds for GOAL - contents at the goal.
WALL, FREE, GOAL = 0.0, REACH, 2 * REACH

_QUARTERS = np.array([0.0, math.pi / 2])  # the cosine of an angle less this is its cosine, its sine
_STRIDE = np.array([[float(WIDTH)], [1.0]])  # (2, 1): from a cell to the next along x, along y
_LINES = np.array([0.0, 1.0]).reshape(2, 1, 1, 1)  # the first and the second line met
# Both sides of the robot, a hair more than the clearance away: else a robot that aims exactly at a
# corner would meet neither of its walls.
_EDGES = (CLEARANCE + 1e-9) * np.array([-1.0, 1.0]).reshape(2, 1, 1)


@frozen(eq=False)
class Ground:
    """R mazes as one flat array: contents `cells` (R WIDTH^2,), indices `origin` (R,) of (0, 0)."""

    cells: np.ndarray
    origin: np.ndarray

    @classmethod
    def of(cls, walls: np.ndarray, goal: np.ndarray) -> Ground:
        """The ground of mazes with walls (R, SIDE, SIDE) bool and goal cells (R, 2) of integers."""
        rows = np.arange(len(walls))
        cells = np.full((len(walls), WIDTH, WIDTH), WALL)
        inside = slice(PADDING, PADDING + SIDE)
        cells[:, inside, inside] = np.where(walls, WALL, FREE)
        cells[rows, goal[:, 0] + PADDING, goal[:, 1] + PADDING] = GOAL
        return cls(cells.ravel(), rows * float(WIDTH**2) + PADDING * WIDTH + PADDING)

    def at(self, index: np.ndarray) -> np.ndarray:
        """Contents of the cells at `index`, integers held as float64."""
        contents: np.ndarray = self.cells.take(index.astype(np.int64))
        return contents


def directions(angle: np.ndarray) -> np.ndarray:
    """Unit vectors (2, ...) at angles (...) in radians, counted from the x axis to the left."""
    vectors: np.ndarray = np.cos(angle - _QUARTERS.reshape(2, *[1] * angle.ndim))
    return vectors


def look(
    ground: Ground, position: np.ndarray, direction: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distance (K, R) along each ray to the first wall, and whether it meets the goal before.

    `position` (2, R), `direction` (2, K, R) of unit vectors, none along an axis to the last digit;
    nothing is seen beyond REACH, which is the distance read there.
    """
    cell = np.floor(position)
    sign, inverse = np.sign(direction), 1 / direction
    # A ray of 2 m meets at most two lines of a kind. From here on: (line, axis, K, R).
    first = (0.5 * sign - (position - cell - 0.5)[:, None]) * inverse
    distance = np.minimum(first + np.abs(inverse) * _LINES, REACH)
    aside = np.floor(distance * direction[::-1] + position[::-1, None])
    start = cell * _STRIDE + ground.origin
    beyond = start[:, None] + sign * _STRIDE[:, None] * (1 + _LINES)
    contents = ground.at(beyond + aside * _STRIDE[::-1, None])
    wall = np.maximum(distance, contents).min((0, 1)).clip(max=REACH)
    goal = np.maximum(distance, GOAL - contents).min((0, 1))
    # A robot in the goal's cell meets it at once.
    here = GOAL - ground.at(start[0] + cell[1])
    return wall, np.minimum(goal, here) < wall


def advance(ground: Ground, position: np.ndarray, move: np.ndarray) -> np.ndarray:
    """Where moves (2, R) from positions (2, R) end, going as far as no wall is in their way.

    A robot slides along the border of the square, but stops at a wall within. If it keeps CLEARANCE
    from all walls before, it does afterwards. Moves are cut to LONGEST_MOVE along each axis.
    """
    aim = position + move.clip(-LONGEST_MOVE, LONGEST_MOVE)
    move = aim.clip(BORDER, SIDE - BORDER) - position
    cell, sign = np.floor(position), np.sign(move)
    # The share is that of the move after which the robot's clearance meets the next cell, and FREE
    # where that is beyond the end. Where a robot does not move along an axis the division is by 0;
    # fmin and fmax turn the infinity or NaN into a number.
    line = cell + 0.5 + (0.5 - CLEARANCE) * sign
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.fmax(np.fmin((line - position) / move, FREE), 0.0)
    # Two cells have to be free there where the robot is at the edge between them.
    aside = np.floor(position[::-1] + share * move[::-1] + _EDGES)
    beyond = (cell + sign) * _STRIDE + ground.origin
    contents = ground.at(beyond + aside * _STRIDE[::-1]).min(0)
    first = np.maximum(share, contents).min(0)
    end: np.ndarray = position + (first - BACK_OFF).clip(0.0, 1.0) * move
    return end
