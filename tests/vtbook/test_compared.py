"""The comparison: other tasks, and settings that the stored runs have chosen."""

import numpy as np
import pytest
from attrs import evolve

from vtbook.experiments.compared import ENVIRONMENTS, SPACES, candidate
from vtbook.experiments.factorial import FACTORIAL, PARTS, ROOMS, effects
from vtlab.run import run_batch
from vtlab.store import weights
from vtlib.training import Diverged

EACH = pytest.mark.parametrize("e", ENVIRONMENTS, ids=lambda e: e.experiment.name)


@EACH
def test_what_earns_most_in_tuning_is_chosen(e):
    for label, number in zip(SPACES, e.chosen, strict=True):
        tried = range(len(e.candidates(label)))
        stayed = [k for k in tried if candidate(label, k) not in e.diverged]
        means = [e.earned(e.tuning(), candidate(label, k)).mean() for k in stayed]
        assert number == stayed[int(np.argmax(means))], label


@EACH
def test_a_setting_that_is_out_does_diverge(e):
    tuning, judged = e.tuning(), e.judged()
    assert not set(e.diverged) & {*tuning.algorithms, *judged.algorithms}
    numbers = dict(zip(SPACES, e.chosen, strict=True))
    for name in e.diverged:
        label, _, number = name.partition(", setting ")
        runs, at = (tuning, int(number)) if number else (judged, numbers[label])
        one = evolve(runs, algorithms={name: e.candidates(label)[at]})
        with pytest.raises(Diverged, match="not finite"):
            run_batch(one, name, range(tuning.runs), weights(one.pool))


def test_a_part_is_what_its_combinations_earn_beyond_those_without():
    found = {part: effects(part) for part in PARTS}
    assert [len(x) for x in found.values()] == [20, 20, 20, 8, 16, 16, 20]
    three, one = (ROOMS.earned(FACTORIAL, f"mean, held, full {count}, max") for count in (3, 1))
    assert (found["three components, not one"] == three - one).all(1).sum() == 1
