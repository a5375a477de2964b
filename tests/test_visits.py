"""Measures of visits: positions placed by hand, and what holds for any positions."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from vtlib.envs.episodes import RecordedEpisodes
from vtlib.envs.rooms import Rooms
from vtlib.streams import Stream
from vtlib.visits import (
    arrivals,
    cell_counts,
    cells_visited,
    effective_cells,
    share_at_door,
    uniform_share_at_door,
)

PROPERTY = settings(deadline=None, derandomize=True)
DOOR = 5.0
UNDER = float(np.nextafter(np.float32(5), np.float32(0)))  # the last height below the wall
MEASURES = [
    arrivals,
    lambda visited: share_at_door(visited, DOOR),
    cell_counts,
    cells_visited,
    effective_cells,
]


def run_at(*positions: tuple[float, float]) -> np.ndarray:
    """One run (1, T, 2) that visits these positions."""
    return np.array([positions], dtype=np.float32)


def evenly(cells: int, times: int) -> np.ndarray:
    """One run that visits each of the first so many cells of the lower room so many times."""
    return run_at(*[(i % 10 + 0.5, i // 10 + 0.5) for i in range(cells)] * times)


@pytest.mark.parametrize(
    ("position", "arrived"),
    [
        ((10, 10), True),
        ((9, 10), True),
        ((10, 9), True),
        ((9.3, 9.3), True),
        ((9.29, 9.29), False),
        ((8.99, 10), False),
        ((9, 9), False),
        ((0, 0), False),
    ],
)
def test_an_arrival_lies_within_one_of_the_corner(position, arrived):
    assert arrivals(run_at((0, 0), position)).tolist() == [arrived]


def test_every_arrival_counts():
    assert arrivals(run_at((10, 10), (0, 0), (9.5, 9.5), (9.5, 9.5))).tolist() == [3]


def test_arrivals_are_the_environments_terminal_states():
    runs = range(40)
    tasks = replace(Rooms.from_doors([[DOOR]] * len(runs)), uniform_start=True)
    episodes = RecordedEpisodes(
        tasks, Stream("visits", runs, "noise"), Stream("visits", runs, "start")
    )
    rng = np.random.default_rng(0)
    ends = torch.zeros(len(runs), dtype=torch.int64)
    for _ in range(300):
        # up and right twice as often as back, so that there is something to count
        action = torch.from_numpy(rng.choice([0, 0, 1, 1, 2, 3], len(runs)))
        ends += episodes.step(action).terminal
    assert ends.sum() > 100
    np.testing.assert_array_equal(arrivals(episodes.visited.numpy()), ends)


@pytest.mark.parametrize(
    ("position", "near"),
    [
        ((5, 3), True),
        ((5, UNDER), True),
        ((3.1, 4.9), True),
        ((5, 2.99), False),
        ((2.9, 4.9), False),
        ((3.5, 3.5), False),
    ],
)
def test_at_the_door_is_within_two_of_its_centre(position, near):
    # beside one visit that is not at the door
    assert share_at_door(run_at((0.5, 0.5), position), DOOR).tolist() == [near / 2]


def test_a_door_elsewhere_has_its_own_surroundings():
    visited = run_at((1, 4), (5, 4), (5, 4), (9, 4))
    assert [share_at_door(visited, door)[0] for door in (1.0, 5.0, 9.0)] == [0.25, 0.5, 0.25]


def test_what_lies_on_or_above_the_wall_does_not_count():
    below = [(5, 4.5), (0.5, 0.5), (1.5, 0.5)]
    both = [*below, (5, 5), (5, 5.5), (4.5, 9.5), (10, 10)]
    for measure in MEASURES[1:]:
        np.testing.assert_array_equal(measure(run_at(*both)), measure(run_at(*below)))
    assert share_at_door(run_at(*both), DOOR)[0] == pytest.approx(1 / 3)


def test_a_run_that_never_is_in_the_lower_room_has_no_share_and_no_cells():
    visited = run_at((5, 5), (0, 9), (10, 10))
    assert share_at_door(visited, DOOR).tolist() == [0.0]
    assert cell_counts(visited).sum() == 0
    assert cells_visited(visited).tolist() == [0]
    assert np.isfinite(effective_cells(visited)).all()


@pytest.mark.parametrize(
    ("position", "cell"),
    [
        ((0, 0), (0, 0)),
        ((0.99, 0.99), (0, 0)),
        ((1, 0), (1, 0)),
        ((0, 1), (0, 1)),
        # the square is closed: its right side belongs to the last cell
        ((10, 2.5), (9, 2)),
        ((7.5, UNDER), (7, 4)),
    ],
)
def test_the_cell_of_a_position(position, cell):
    counts = cell_counts(run_at(position))
    assert counts.shape == (1, 10, 5)
    assert [tuple(index) for index in np.argwhere(counts[0])] == [cell]


def test_repeated_visits_of_a_cell_add_up():
    counts = cell_counts(run_at((2.5, 3.5), (2.1, 3.9), (2.5, 3.5), (3.5, 2.5)))[0]
    assert counts[2, 3] == 3
    assert counts[3, 2] == 1
    assert counts.sum() == 4


@pytest.mark.parametrize("times", [1, 7])
@pytest.mark.parametrize("cells", [1, 2, 13, 50])
def test_cells_visited_equally_often_are_all_effective(cells, times):
    visited = evenly(cells, times)
    assert cells_visited(visited).tolist() == [cells]
    np.testing.assert_allclose(effective_cells(visited), cells)


def test_unequal_visits_leave_fewer_effective_cells():
    # entropy of a quarter and three quarters
    expected = math.exp(0.25 * math.log(4) + 0.75 * math.log(4 / 3))
    visited = run_at((0.5, 0.5), (1.5, 0.5), (1.5, 0.5), (1.5, 0.5))
    np.testing.assert_allclose(effective_cells(visited), expected)
    assert cells_visited(visited).tolist() == [2]


@pytest.mark.parametrize("measure", MEASURES)
def test_a_run_is_measured_alone(measure):
    rng = np.random.default_rng(0)
    # each run keeps to a part of the square of its own, one of them above the wall
    visited = rng.uniform(0, 5, (4, 60, 2)) + np.array([[[0, 0]], [[5, 0]], [[2, 2]], [[5, 5]]])
    visited = visited.astype(np.float32)
    alone = np.concatenate([measure(visited[r : r + 1]) for r in range(len(visited))])
    np.testing.assert_array_equal(measure(visited), alone)
    assert len(np.unique(alone.reshape(len(visited), -1), axis=0)) > 1


def test_evenly_spread_visits_lie_at_the_door_as_often_as_its_half_circle_is_large():
    rng = np.random.default_rng(0)
    visits = 500_000
    visited = rng.uniform((0, 0), (10, 5), (1, visits, 2)).astype(np.float32)
    expected = uniform_share_at_door()
    assert expected == pytest.approx(2 * math.pi / 50)
    # four standard errors of a share of independent visits
    error = 4 * math.sqrt(expected * (1 - expected) / visits)
    for door in (2.0, 5.0, 8.0):
        assert share_at_door(visited, door)[0] == pytest.approx(expected, abs=error)
    # a side cuts off part of the half circle, beyond what chance could
    assert share_at_door(visited, 0.5)[0] < expected - 10 * error


coordinate = st.floats(0, 10, width=32)
anywhere = st.tuples(coordinate, coordinate)
in_lower_room = st.tuples(coordinate, st.floats(0, UNDER, width=32))


@PROPERTY
@given(st.lists(anywhere, max_size=80), in_lower_room)
def test_effective_cells_lie_between_one_and_the_cells_visited(positions, one):
    visited = run_at(*positions, one)
    effective, entered = effective_cells(visited)[0], cells_visited(visited)[0]
    rounding = 1e-9
    assert 1 - rounding <= effective <= entered * (1 + rounding)
    assert entered <= min(50, 1 + len(positions))
    assert 0 <= share_at_door(visited, DOOR)[0] <= 1


@PROPERTY
@given(st.lists(in_lower_room, min_size=1, max_size=80))
def test_effective_cells_equal_their_definition(positions):
    cells = Counter((min(int(x), 9), int(y)) for x, y in positions)
    shares = [n / len(positions) for n in cells.values()]
    expected = math.prod(p**-p for p in shares)
    visited = run_at(*positions)
    assert effective_cells(visited)[0] == pytest.approx(expected)
    assert cells_visited(visited)[0] == len(cells)
