"""Measures of visits: what holds for any positions, and for evenly spread ones."""

import math
from collections import Counter

import numpy as np
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st

from vtbook.visits import arrivals, coverage, progress, share_at_door, uniform_share_at_door
from vtlab.envs.rooms import Rooms

# On a lattice, so that borders of cells, of the lower room and of what is near are hit exactly.
PLACE = st.integers(0, 80).map(lambda x: x / 8)
UNDER = float(np.nextafter(np.float32(5), np.float32(0)))  # the last height below the wall


def test_arrivals_are_the_environments_ends_of_episodes():
    rng, count = np.random.default_rng(0), 4_000
    state, noise = rng.uniform(7, 10, (count, 2)), rng.standard_normal((count, 2))
    action = torch.from_numpy(rng.integers(4, size=count))
    moved = torch.from_numpy(state).float(), action, torch.from_numpy(noise).float()
    after, _, ended = Rooms.from_doors([[5.0]] * count).step(*moved)
    ends = ended.view(40, 100).sum(1)
    assert ends.min() > 0
    np.testing.assert_array_equal(arrivals(after.view(40, 100, 2).numpy()), ends)


@settings(deadline=None, derandomize=True)
@given(st.lists(st.tuples(PLACE, PLACE), min_size=1, max_size=80), PLACE)
@example([(0, 0), (1, 0), (0, 1), (0.99, 0.99), (10, 2.5), (7.5, UNDER), (3, 3), (3, UNDER)], 3)
def test_measures_of_the_lower_room_equal_their_definitions(positions, door):
    below = [(x, y) for x, y in positions if y < 5]
    near = [place for place in below if math.dist(place, (door, 5)) <= 2]
    # the square is closed: its right side belongs to the last cell
    cells = Counter((min(int(x), 9), int(y)) for x, y in below)
    shares = np.array(list(cells.values())) / max(len(below), 1)
    # of two runs, the other never below the wall
    runs = np.array([positions, [(3, 5)] * len(positions)], dtype=np.float32)
    found = coverage(runs)
    assert share_at_door(runs, door).tolist() == [len(near) / max(len(below), 1), 0]
    right = sum(count for (x, _), count in cells.items() if x >= 5) / max(len(below), 1)
    assert found["visits right of the middle"].tolist() == pytest.approx([right, 0])
    assert found["cells visited"].tolist() == [len(cells), 0]
    assert found["effective cells"].tolist() == pytest.approx([(shares**-shares).prod(), 1])


def test_evenly_spread_visits_lie_at_the_door_as_often_as_its_half_circle_is_large():
    x, y = np.meshgrid(np.arange(0.005, 10, 0.01), np.arange(0.005, 5, 0.01))
    spread = np.stack([x, y], -1).reshape(1, -1, 2)
    for door in (2.0, 8.0):
        assert share_at_door(spread, door) == pytest.approx(uniform_share_at_door(), rel=1e-3)


def test_progress_is_the_share_of_moves_beyond_the_wall_that_lead_nearer_to_the_goal():
    # up, right and away again; the move through the door and that from the goal are none
    walk = [(5, 4.5), (5, 5.5), (5, 6.5), (6, 6.5), (5, 6.5), (9.5, 9.5), (0, 0)]
    below = [(x, 1) for x in range(len(walk))]
    found = progress(np.array([walk, below], dtype=np.float32))
    assert found[0] == 3 / 4
    assert np.isnan(found[1])
