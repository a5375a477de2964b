"""Runs that are halted are those of the whole run."""

import numpy as np

from vtbook.pauses import pauses
from vtlib.experiments.run import head, prepare


def test_halted_runs_are_those_of_the_whole_run(tiny, weights):
    batch = prepare(tiny, "GVT", [0], weights[:3])
    seen = {t: batch.agent.mu.detach().double().sum().item() for t in pauses(batch, [0, 1, 49])}
    assert list(seen) == [0, 1, 49]
    prints = head(tiny, "GVT", [0], weights[:3])[0, :2, 0]
    np.testing.assert_allclose([seen[1], seen[49]], prints, rtol=1e-4, atol=1e-5)
    assert seen[0] != seen[1]
    assert list(pauses(prepare(tiny, "NT", [0], weights), [0])) == [0]
