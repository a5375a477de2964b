"""Measures of visits: positions placed by hand, and what holds for any positions."""

import math
from collections import Counter

import numpy as np
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st

from vtbook.visits import arrivals, coverage, share_at_door, uniform_share_at_door
from vtlib.envs.rooms import Rooms

UNDER = float(np.nextafter(np.float32(5), np.float32(0)))  # the last height below the wall
IN_LOWER_ROOM = st.tuples(st.floats(0, 10, width=32), st.floats(0, UNDER, width=32))


def visited(*runs):
    """Runs (R, T, 2) that visit these positions."""
    return np.array(runs, dtype=np.float32)


def test_arrivals_are_the_environments_ends_of_episodes():
    rng, count = np.random.default_rng(0), 4_000
    state, noise = rng.uniform(7, 10, (count, 2)), rng.standard_normal((count, 2))
    action = torch.from_numpy(rng.integers(4, size=count))
    moved = torch.from_numpy(state).float(), action, torch.from_numpy(noise).float()
    after, _, ended = Rooms.from_doors([[5.0]] * count).step(*moved)
    ends = ended.view(40, 100).sum(1)
    assert ends.min() > 0
    np.testing.assert_array_equal(arrivals(after.view(40, 100, 2).numpy()), ends)


def test_at_the_door_is_within_two_of_its_centre():
    near, far = [(3, 3), (3, UNDER), (1.1, 4.9)], [(3, 2.99), (0.9, 4.9), (1.5, 3.5)]
    assert share_at_door(visited(near, far), 3.0).tolist() == [1, 0]
    assert share_at_door(visited([*near, *far, (8, 1)]), 3.0) == pytest.approx(3 / 7)


def test_what_lies_on_or_above_the_wall_does_not_count():
    below, above = [(3, 4.5), (0.5, 0.5), (1.5, 0.5)], [(3, 5), (3, 5.5), (4.5, 9.5), (10, 10)]
    runs = visited(below + above, above + above[1:])
    assert share_at_door(runs, 3.0).tolist() == [pytest.approx(1 / 3), 0]
    assert coverage(runs)["cells visited"].tolist() == [3, 0]
    assert coverage(runs)["effective cells"].tolist() == pytest.approx([3, 1])


def test_evenly_spread_visits_lie_at_the_door_as_often_as_its_half_circle_is_large():
    visits, expected = 500_000, uniform_share_at_door()
    spread = np.random.default_rng(0).uniform((0, 0), (10, 5), (1, visits, 2))
    # four standard errors of a share of independent visits
    error = 4 * math.sqrt(expected * (1 - expected) / visits)
    for door in (2.0, 8.0):
        assert share_at_door(spread, door)[0] == pytest.approx(expected, abs=error)


@settings(deadline=None, derandomize=True)
@given(st.lists(IN_LOWER_ROOM, min_size=1, max_size=80))
@example([(0, 0), (1, 0), (0, 1), (0.99, 0.99), (10, 2.5), (7.5, UNDER)])
def test_cells_equal_their_definition(positions):
    # the square is closed: its right side belongs to the last cell
    cells = Counter((min(int(x), 9), int(y)) for x, y in positions)
    found = coverage(visited(positions))
    assert found["cells visited"].tolist() == [len(cells)]
    shares = np.array(list(cells.values())) / len(positions)
    assert found["effective cells"][0] == pytest.approx((shares**-shares).prod())
