"""What a run of Trust sees before each episode, whom it lets play, and what that earns."""

import itertools
from typing import NamedTuple

import numpy as np

from vtbook.experiments.trust import OURS
from vtlab.experiment import Experiment
from vtlab.run import prepare
from vtlab.store import weights
from vtlib.training import arithmetic, iterate
from vtlib.trust import NORMAL, QUARTILES, Trusting


class Decisions(NamedTuple):
    """For E episodes that have ended: who played, its return, the promise and its spread (E,).

    Who played is a source's number, or the number of sources for the learner.
    """

    played: np.ndarray
    gained: np.ndarray
    promise: np.ndarray
    spread: np.ndarray
    sources: int


@arithmetic()
def decisions(experiment: Experiment, run: int, steps: int) -> Decisions:
    """The first steps of a run that is stored, computed anew: its episodes, one by one."""
    sources = weights(experiment.pool)
    batch = prepare(experiment, OURS, [run], sources)
    agent, episodes, q = batch.agent, batch.episodes, experiment.family.q()
    assert isinstance(agent, Trusting)
    chosen, promises = agent.state()["sources"], []

    def promise() -> None:
        """What the sources promise at the first state of an episode, and how far they differ."""
        values = q.q(chosen, q.prepare(episodes.obs.unsqueeze(1)))[0, ..., 0].amax(-1)
        low, middle, high = values.quantile(QUARTILES).tolist()
        promises.append((middle, (high - low) / NORMAL))

    promise()
    for _ in itertools.islice(iterate(agent, episodes), steps):
        if episodes.fresh[0]:
            promise()
    record = agent.records[0]
    ended = len(record.gained)
    promised, spread = np.array(promises)[:ended].T
    played, gained = (np.array(x)[:ended] for x in (record.played, record.gained))
    return Decisions(played, gained, promised, spread, record.count)
