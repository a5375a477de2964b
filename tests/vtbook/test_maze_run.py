"""The first run in a maze: what is told of it on its way, and its walks."""

import numpy as np
import pytest

from vtbook.checkpoints import pauses
from vtbook.experiments.maze import MAIN, MAZE_TARGETS
from vtbook.maze_run import SEEN, follow
from vtlab.run import prepare
from vtlib.rng import Rng

HERE = MAZE_TARGETS[MAIN]


@pytest.fixture(scope="module")
def weights():
    """Sources that nobody has solved."""
    rng = np.random.default_rng(0)
    return 0.1 * rng.standard_normal((20, HERE.family.q().d), dtype=np.float32)


def test_a_run_is_looked_at_where_it_was_asked_for_and_is_not_disturbed(weights):
    found = follow(HERE, "GVT", weights, (5, 10))
    assert list(found) == [5, 10]
    assert np.isfinite(found[10].value)
    assert found[10].deviation > 0
    # what its mean promises at 10 is what the stored run's would
    batch = prepare(HERE, "GVT", [0], weights)
    list(pauses(batch, [10]))
    places = Rng(HERE.stream, [0]).stream("probes")
    places.uniform(SEEN)  # drawn at iteration 5
    q, mu = HERE.family.q(), batch.agent.mu.detach()
    x = q.prepare(batch.agent.remembered(places.uniform(SEEN)).obs)
    assert found[10].value == pytest.approx(float(q.q(mu, x).mean(1).amax(1).mean()), rel=1e-5)
    assert SEEN == 200  # as the page says
