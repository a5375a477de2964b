"""How far weights move from where they began, if the new task has said something of them or not."""

import itertools

import numpy as np

from vtbook.neighbours.anchored import Anchored
from vtlab.experiment import Experiment
from vtlab.run import prepare
from vtlab.store import weights
from vtlib.training import arithmetic, iterate


@arithmetic()
def drift(experiment: Experiment, label: str, runs: int, steps: int) -> np.ndarray:
    """The mean distance of seen and of unseen weights from where they began, (2,).

    Over the first runs of a stored result, which are computed anew for so many steps.
    """
    batch = prepare(experiment, label, range(runs), weights(experiment.pool))
    assert isinstance(batch.agent, Anchored)
    for _ in itertools.islice(iterate(batch.agent, batch.episodes), steps):
        pass
    moved, seen = batch.agent.moved, batch.agent.seen
    return np.array([float(moved[which].mean()) for which in (seen, ~seen)])
