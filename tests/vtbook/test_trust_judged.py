"""The judgement of `vtlib.trust` is on tasks of its own, and each of its experiments can run."""

import numpy as np
import pytest
from attrs import evolve

from vtbook.experiments import EXPERIMENTS
from vtbook.experiments.trust import JUDGED, OURS
from vtlab.run import run_batch


def test_no_stream_was_used_before():
    used = {e.stream or e.name for e in EXPERIMENTS.values()}
    assert not used & {e.stream for e in JUDGED}
    assert len({e.stream for e in JUDGED}) == len(JUDGED)


@pytest.mark.parametrize("experiment", JUDGED, ids=lambda e: e.name)
def test_each_can_run(experiment):
    weights = np.random.default_rng(0).standard_normal(
        (experiment.pool.count, experiment.family.q().d)
    )
    short = evolve(experiment, iterations=200, algorithms={OURS: experiment.algorithms[OURS]})
    assert np.isfinite(run_batch(short, OURS, range(2), weights.astype(np.float32))["greedy"]).all()
