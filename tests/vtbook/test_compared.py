"""The comparison: equal budgets, other tasks, and settings that the stored runs have chosen."""

from __future__ import annotations

import attrs
import numpy as np
import pytest
import torch
from attrs import evolve

from vtbook.experiments.compared import BUDGET, ENVIRONMENTS, SPACES, candidate, changed, drawn
from vtlib.baselines import FineTuning
from vtlib.experiments.run import run_batch, targets
from vtlib.experiments.store import weights
from vtlib.training import Diverged

EACH = pytest.mark.parametrize("e", ENVIRONMENTS, ids=lambda e: e.experiment.name)


@pytest.mark.parametrize("label", SPACES)
def test_every_algorithm_has_the_same_budget_of_different_settings_from_its_space(label):
    settings = drawn(label)
    assert len(settings) == BUDGET - 1
    assert len({tuple(one.items()) for one in settings}) == len(settings)
    for one in settings:
        assert all(one[name] in values for name, values in SPACES[label].items())
    # of more than a hundred settings two draws of seven differ
    assert settings != drawn("GVT" if label != "GVT" else "NT")


@EACH
def test_what_is_drawn_is_set_and_nothing_else(e):
    for label in SPACES:
        default, *others = e.candidates(label)
        for algorithm, values in zip(others, drawn(label), strict=True):
            told = attrs.asdict(algorithm)
            flat = {**told, **told.pop("learner", {})}
            assert {name: flat[name] for name in values} == values
            assert changed(algorithm, values) == algorithm
            back = {name: getattr(default, name) for name in values if hasattr(default, name)}
            if not isinstance(default, FineTuning):
                assert evolve(algorithm, **back) == default


@EACH
def test_the_chosen_setting_is_the_one_that_earns_most_in_tuning(e):
    for label, number in zip(SPACES, e.chosen, strict=True):
        stayed = [k for k in range(BUDGET) if candidate(label, k) not in e.diverged]
        means = [e.earned(e.tuning(), candidate(label, k)).mean() for k in stayed]
        assert number == stayed[int(np.argmax(means))], label


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
    for name, tuned in e.experiment.family.values(targets(tuning, range(tuning.runs))).items():
        told = e.experiment.family.values(targets(judged, range(judged.runs)))[name]
        if np.ptp(told):
            assert not np.isin(tuned, told).all()
    assert list(judged.algorithms) == list(SPACES)


@EACH
def test_shares_run_from_the_floor_to_the_optimum(e):
    label = "1-MGVT"
    shares = e.earned(e.judged(), label)
    assert shares.shape == (e.judged().runs,)
    assert torch.isfinite(torch.from_numpy(shares)).all()
    assert -0.1 < shares.min() <= shares.max() < 1.1
