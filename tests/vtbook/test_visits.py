"""Measures of visits: positions placed by hand, and what holds for any positions."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st

from vtbook.visits import arrivals, coverage, share_at_door, uniform_share_at_door
from vtlib.envs.rooms import Rooms

PROPERTY = settings(deadline=None, derandomize=True)
DOOR = 5.0
UNDER = float(np.nextafter(np.float32(5), np.float32(0)))  # the last height below the wall
OF_LOWER_ROOM = [
    lambda visited: share_at_door(visited, DOOR),
    lambda visited: coverage(visited)["cells visited"],
    lambda visited: coverage(visited)["effective cells"],
]


def run_at(*positions: tuple[float, float]) -> np.ndarray:
    """One run (1, T, 2) that visits these positions."""
    return np.array([positions], dtype=np.float32)


def test_arrivals_are_the_environments_ends_of_episodes():
    rng, runs = np.random.default_rng(0), 40
    tasks = Rooms.from_doors([[DOOR]] * runs)
    state, visited, ends = torch.from_numpy(rng.uniform(0, 10, (runs, 2))).float(), [], 0
    for _ in range(300):
        # up and right twice as often as back, so that there is something to count
        action = torch.from_numpy(rng.choice([0, 0, 1, 1, 2, 3], runs))
        noise = torch.from_numpy(rng.standard_normal((runs, 2))).float()
        state, _, ended = tasks.step(state, action, noise)
        visited.append(state.numpy())
        ends = ends + ended.int().numpy()
        state = torch.where(ended.unsqueeze(1), torch.zeros(runs, 2), state)
    assert ends.sum() > 30
    np.testing.assert_array_equal(arrivals(np.stack(visited, 1)), ends)


@pytest.mark.parametrize("door", [3.0, 5.0])
def test_at_the_door_is_within_two_of_its_centre(door):
    near = run_at((0, 3), (0, UNDER), (-1.9, 4.9)) + np.float32([door, 0])
    far = run_at((0, 2.99), (-2.1, 4.9), (-1.5, 3.5), (5, 1)) + np.float32([door, 0])
    assert share_at_door(near, door) == 1
    assert share_at_door(far, door) == 0
    assert share_at_door(np.concatenate([near, far], 1), door) == pytest.approx(3 / 7)


def test_what_lies_on_or_above_the_wall_does_not_count():
    below = [(5, 4.5), (0.5, 0.5), (1.5, 0.5)]
    above = [(5, 5), (5, 5.5), (4.5, 9.5), (10, 10)]
    for measure in OF_LOWER_ROOM:
        np.testing.assert_array_equal(measure(run_at(*below, *above)), measure(run_at(*below)))
    assert [float(np.sum(measure(run_at(*above)))) for measure in OF_LOWER_ROOM] == [0, 0, 1]


@pytest.mark.parametrize("measure", [arrivals, *OF_LOWER_ROOM])
def test_a_run_is_measured_alone(measure):
    rng = np.random.default_rng(0)
    # each run keeps to a part of the square of its own, one of them above the wall
    visited = rng.uniform(0, 5, (4, 60, 2)) + np.array([[[0, 0]], [[5, 0]], [[2, 2]], [[5, 5]]])
    alone = np.concatenate([measure(visited[r : r + 1]) for r in range(len(visited))])
    np.testing.assert_array_equal(measure(visited), alone)
    assert len(np.unique(alone.reshape(len(visited), -1), axis=0)) > 1


def test_evenly_spread_visits_lie_at_the_door_as_often_as_its_half_circle_is_large():
    visits = 500_000
    visited = np.random.default_rng(0).uniform((0, 0), (10, 5), (1, visits, 2))
    expected = uniform_share_at_door()
    # four standard errors of a share of independent visits
    error = 4 * math.sqrt(expected * (1 - expected) / visits)
    for door in (2.0, 5.0, 8.0):
        assert share_at_door(visited, door)[0] == pytest.approx(expected, abs=error)
    # a side cuts off part of the half circle, beyond what chance could
    assert share_at_door(visited, 0.5)[0] < expected - 10 * error


coordinate = st.floats(0, 10, width=32)
in_lower_room = st.tuples(coordinate, st.floats(0, UNDER, width=32))


@PROPERTY
@given(st.lists(in_lower_room, min_size=1, max_size=80))
@example([(0, 0), (1, 0), (0, 1), (0.99, 0.99), (10, 2.5), (7.5, UNDER)])
def test_cells_equal_their_definition(positions):
    # the square is closed: its right side belongs to the last cell
    cells = Counter((min(int(x), 9), int(y)) for x, y in positions)
    found = coverage(run_at(*positions))
    assert found["cells visited"].tolist() == [len(cells)]
    shares = np.array(list(cells.values())) / len(positions)
    assert found["effective cells"][0] == pytest.approx((shares**-shares).prod())
