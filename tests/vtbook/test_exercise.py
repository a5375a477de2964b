"""Settings of a reader's own beside the stored runs: the same runs, and a true difference."""

from __future__ import annotations

import re

import pytest
from attrs import evolve

from vtbook.exercise import try_settings
from vtbook.experiments.rooms import ROOMS_EVALUATION, ROOMS_SOURCES
from vtlib.experiments import returns
from vtlib.stats import mean_interval

HERE = ROOMS_EVALUATION.published
OWN = HERE.algorithms["1-MGVT"]


def numbers(told: str) -> list[list[float]]:
    """Centre, low and high of each line but the first."""
    lines = told.replace("−", "-").splitlines()[1:]
    return [[float(x) for x in re.findall(r"[-+]?\d[\d.e-]*", line)] for line in lines]


@pytest.mark.parametrize(
    ("experiment", "label"), [(HERE, "1-MGVT"), (ROOMS_SOURCES.published, "1-MGVT-from-2")]
)
def test_the_stored_settings_change_nothing(experiment, label):
    told = try_settings(experiment, label, experiment.algorithms[label], 2, 300)
    assert told.splitlines()[0] == f"{label}, 2 runs, mean learning return over 300 iterations"
    stored, yours, difference = numbers(told)
    assert yours == pytest.approx(stored, abs=1e-3)
    assert difference == pytest.approx([0, 0, 0], abs=1e-3)


def test_other_settings_are_trained_and_compared_by_run():
    told = try_settings(HERE, "1-MGVT", evolve(OWN, lambda_=1e-2), 3, 2_000)
    stored, yours, difference = numbers(told)
    kept = returns(HERE, "1-MGVT").learning.isel(run=slice(3)).sel(iteration=slice(2_000))
    band = mean_interval(kept.mean("iteration").values)
    assert stored == pytest.approx([band.centre, band.low, band.high], rel=1e-2)
    assert difference[0] == pytest.approx(yours[0] - stored[0], abs=2e-3)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("Q", OWN, 2, 200), "label must be one of"),
        (("1-MGVT", OWN, 1, 200), "runs must be"),
        (("1-MGVT", OWN, 21, 200), "runs must be"),
        (("1-MGVT", OWN, 2, 50), "iterations must be"),
        (("1-MGVT", OWN, 2, 20_100), "iterations must be"),
    ],
)
def test_bad_input_is_refused_before_anything_is_trained(given, message):
    with pytest.raises(ValueError, match=message):
        try_settings(HERE, *given)
