"""The comparison: other tasks, and settings that the stored runs have chosen."""

import numpy as np
import pytest
from attrs import evolve

from vtbook.experiments.compared import ENVIRONMENTS, FOUR, SPACES, candidate
from vtbook.experiments.factorial import FACTORIAL, PARTS, ROOMS, effects
from vtlab.run import run_batch, targets
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


@EACH
def test_four_updates_and_one_share_their_default_and_not_their_draws(e):
    for label in ("fine-tuned", "1-MGVT", "3-MGVT"):
        one, four = e.candidates(label), e.candidates(label + FOUR)
        assert four[0].settings == one[0]
        assert any(many.settings not in one for many in four[1:])


@EACH
def test_tasks_of_tuning_and_of_judgement_differ(e):
    tuning, judged = e.tuning(), e.judged()
    assert judged.iterations == tuning.iterations == e.iterations
    assert list(judged.algorithms) == [x for x in SPACES if x not in e.diverged]
    told, tuned = (x.family.values(targets(x, range(x.runs))) for x in (judged, tuning))
    for name, values in told.items():
        seen = {x.tobytes() for x in values}
        assert len(seen) == 1 or not {x.tobytes() for x in tuned[name]} <= seen


def test_a_part_is_what_its_combinations_earn_beyond_those_without():
    found = {part: effects(part) for part in PARTS}
    assert [len(x) for x in found.values()] == [20, 20, 20, 8, 16, 16, 20]
    three, one = (ROOMS.earned(FACTORIAL, f"mean, held, full {count}, max") for count in (3, 1))
    assert (found["three components, not one"] == three - one).all(1).sum() == 1
