"""The comparison: equal budgets, other tasks, and settings that the stored runs have chosen."""

import attrs
import numpy as np
import pytest
from attrs import evolve

from vtbook.experiments.compared import BUDGET, ENVIRONMENTS, SPACES, candidate, drawn
from vtbook.experiments.maze import MAIN, MAZE_TARGETS
from vtbook.experiments.mountain_car import CAR
from vtbook.experiments.recommended import EXPERIMENTS as RECOMMENDED
from vtlib.experiments.run import run_batch, targets
from vtlib.experiments.store import weights
from vtlib.recommended import Recommended
from vtlib.training import Diverged

EACH = pytest.mark.parametrize("e", ENVIRONMENTS, ids=lambda e: e.experiment.name)


def fields(algorithm):
    """An algorithm's settings, with those of the learner that fine-tuning starts."""
    told = attrs.asdict(algorithm)
    learner = told.pop("learner", {})
    return told | learner


def test_every_algorithm_has_the_same_budget_of_different_settings_from_its_space():
    for label, space in SPACES.items():
        settings = drawn(label)
        assert len({tuple(one.items()) for one in settings}) == len(settings) == BUDGET - 1
        assert all(one[name] in space[name] for one in settings for name in space)
    # two draws of seven from the same space, which has more than a hundred
    assert drawn("1-MGVT") != drawn("3-MGVT")


@EACH
def test_what_is_drawn_is_set_and_nothing_else_and_what_earns_most_in_tuning_is_chosen(e):
    for label, number in zip(SPACES, e.chosen, strict=True):
        default, *others = e.candidates(label)
        expected = [fields(default) | values for values in drawn(label)]
        assert [fields(one) for one in others] == expected
        stayed = [k for k in range(BUDGET) if candidate(label, k) not in e.diverged]
        means = [e.earned(e.tuning(), candidate(label, k)).mean() for k in stayed]
        assert number == stayed[int(np.argmax(means))], label
    # shares of the way from the floor to the optimum
    shares = e.earned(e.judged(), "1-MGVT")
    assert shares.shape == (e.judged().runs,)
    assert -0.1 < shares.min() <= shares.max() < 1.1


@EACH
def test_a_setting_that_is_out_does_diverge(e):
    tuning = e.tuning()
    assert not set(e.diverged) & set(tuning.algorithms)
    for name in e.diverged:
        label, _, number = name.rpartition(", setting ")
        one = evolve(tuning, algorithms={name: e.candidates(label)[int(number)]})
        with pytest.raises(Diverged, match="not finite"):
            run_batch(one, name, range(tuning.runs), weights(one.pool))


@EACH
def test_tasks_of_tuning_and_of_judgement_differ(e):
    tuning, judged = e.tuning(), e.judged()
    assert judged.iterations == tuning.iterations == e.iterations
    assert list(judged.algorithms) == list(SPACES)
    values = e.experiment.family.values
    told = values(targets(judged, range(judged.runs)))
    for name, tuned in values(targets(tuning, range(tuning.runs))).items():
        assert np.ptp(told[name]) == 0 or not np.isin(tuned, told[name]).all()


@pytest.mark.parametrize("ours", RECOMMENDED, ids=lambda e: e.name)
def test_the_recommended_method_has_the_tasks_and_sources_of_those_beside_it(ours):
    beside = [*(e.judged() for e in ENVIRONMENTS), CAR.published, MAZE_TARGETS[MAIN].published]
    (other,) = (x for x in beside if x.stream == ours.stream)
    assert ours.iterations <= other.iterations
    for key in ("family", "pool", "runs", "sources", "every", "excluded", "runs_per_task"):
        assert getattr(ours, key) == getattr(other, key), key
    settings = [x for x in ours.algorithms.values() if isinstance(x, Recommended)]
    assert settings[0] == Recommended()
