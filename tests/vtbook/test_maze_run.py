"""The first run in a maze: what is told of it on its way, and its walks."""

import numpy as np
import pytest
import torch

from vtbook.experiments.maze import MAIN, MAZE_TARGETS
from vtbook.maze_run import SEEN, follow, maze_of, six_walks
from vtlab.run import prepare

HERE = MAZE_TARGETS[MAIN].published


@pytest.fixture(scope="module")
def weights():
    """Sources that nobody has solved."""
    rng = np.random.default_rng(0)
    return 0.1 * rng.standard_normal((20, HERE.family.q().d), dtype=np.float32)


def forward(states):
    return torch.zeros(len(states), dtype=torch.int64)


def test_walks_of_any_policy_begin_at_the_same_six_free_places():
    one = six_walks(HERE, forward)
    other = six_walks(HERE, lambda states: 1 + forward(states))
    assert len(one) == 6
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a[0], b[0])
    assert any(len(a) != len(b) or (a != b).any() for a, b in zip(one, other, strict=True))


def test_a_run_is_looked_at_where_it_was_asked_for_and_is_not_disturbed(weights):
    found = follow(HERE, "GVT", weights, believed=(5, 10), walked=(0, 10))
    assert (list(found.beliefs), list(found.walks)) == ([5, 10], [0, 10])
    value, deviation = found.beliefs[10]
    assert np.isfinite(value)
    assert deviation > 0
    # what is believed at 10 does not depend on where else the run was halted
    alone = follow(HERE, "GVT", weights, walked=(10,))
    for a, b in zip(alone.walks[10], found.walks[10], strict=True):
        np.testing.assert_array_equal(a, b)
    begun = prepare(HERE, "GVT", [0], weights).agent.mu.detach()
    q, maze = HERE.family.q(), maze_of(HERE)

    def greedy(states):
        obs = maze.select([0] * len(states)).observe(states)
        return q.q(begun, q.prepare(obs[None]))[0].mean(0).argmax(0)

    for a, b in zip(six_walks(HERE, greedy), found.walks[0], strict=True):
        np.testing.assert_array_equal(a, b)
    assert SEEN == 200  # as the page says
