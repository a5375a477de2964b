"""Settings of a reader's own beside the stored runs: the same runs, and a true difference."""

import os
import re
from unittest.mock import Mock

import pytest
from attrs import evolve

from vtbook import exercise, processors
from vtbook.exercise import try_settings
from vtbook.experiments.rooms import ROOMS_SOURCES
from vtlab.store import returns
from vtlib.stats import mean_interval

HERE, LABEL = ROOMS_SOURCES.published, "1-MGVT-from-2"
OWN = HERE.algorithms[LABEL]


@pytest.mark.parametrize("lambda_", [OWN.lambda_, 1e-2])
def test_settings_are_trained_and_compared_by_run(monkeypatch, lambda_):
    settings, asked = evolve(OWN, lambda_=lambda_), Mock(wraps=exercise.run_batch)
    monkeypatch.setattr(exercise, "run_batch", asked)
    told = try_settings(HERE, LABEL, settings, 2, 1_000)
    assert asked.call_args.kwargs == {"threads": processors()}
    head, *lines = told.replace("−", "-").splitlines()
    assert head == f"{LABEL}, 2 runs, mean learning return over 1,000 iterations"
    stored, yours, difference = (
        [float(x) for x in re.findall(r"[-+]?\d[\d.e-]*", line)] for line in lines
    )
    kept = returns(HERE, LABEL).learning.isel(run=slice(2)).sel(iteration=slice(1_000))
    band = mean_interval(kept.mean("iteration").values)
    assert stored == pytest.approx([band.centre, band.low, band.high], rel=1e-2)
    assert difference[0] == pytest.approx(yours[0] - stored[0], abs=2e-3)
    same = settings == OWN
    assert (difference == pytest.approx([0, 0, 0], abs=1e-3)) == same
    assert (yours == pytest.approx(stored, abs=1e-3)) == same


@pytest.mark.parametrize(("runs", "iterations"), [(1, 200), (21, 200), (2, 40), (2, 20_100)])
def test_bad_input_is_refused_before_anything_is_trained(runs, iterations):
    with pytest.raises(ValueError, match=r"^(runs|iterations) must be"):
        try_settings(HERE, LABEL, OWN, runs, iterations)


def test_processors_are_those_that_this_process_may_use_where_a_system_tells(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 5, 6}, raising=False)
    assert processors() == 3
    monkeypatch.delattr(os, "sched_getaffinity")
    assert processors() == os.cpu_count()
