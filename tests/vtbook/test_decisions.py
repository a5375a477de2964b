"""What a run of Trust saw before its episodes is what its own record was told."""

import itertools

import numpy as np

from vtbook.decisions import decisions
from vtbook.experiments.trust import OURS, PLACES
from vtlab.run import prepare
from vtlab.store import weights
from vtlib.training import arithmetic, iterate

STEPS = 200


def test_promises_explain_by_how_much_returns_fell_short():
    place = next(x for x in PLACES if x.title == "cartpole, two wirings")
    told = decisions(place.experiment, 0, STEPS)
    with arithmetic():
        batch = prepare(place.experiment, OURS, [0], weights(place.experiment.pool))
        for _ in itertools.islice(iterate(batch.agent, batch.episodes), STEPS):
            pass
    record = batch.agent.records[0]
    assert len(told.played) == len(record.gained) > 1
    assert told.played.tolist() == record.played[: len(record.gained)]
    short = np.maximum(told.promise - told.gained, 0) / told.spread
    np.testing.assert_allclose(short, record.short, rtol=1e-4)
    assert short[0] > 0
