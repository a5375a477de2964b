"""Runs made again: they are the stored ones, an interrupt keeps what is done, settings compare."""

import os
import re
import signal
import threading
from unittest.mock import Mock

import numpy as np
import pytest
from attrs import evolve

from vtbook import rerun
from vtbook.experiments.rooms import ROOMS_EVALUATION, ROOMS_EXPLORATION, ROOMS_SOURCES
from vtbook.page import Page
from vtbook.rerun import try_settings
from vtlab.stats import mean_interval
from vtlab.store import returns
from vtlab.workers import processors

ROOMS, HERE, LABEL = ROOMS_EVALUATION, ROOMS_SOURCES, "1-MGVT-from-2"
OWN = HERE.algorithms[LABEL]


def stored_learning(experiment, label, runs, iterations):
    stored = returns(experiment, label).isel(run=slice(runs)).sel(iteration=slice(iterations))
    return stored.learning.values


@pytest.mark.parametrize("label", ["NT", "GVT", "1-MGVT"])
def test_runs_made_again_are_the_stored_ones_and_drawn_over_them(label):
    figure = Page(ROOMS_EVALUATION).rerun(label, runs=2, iterations=300)
    (ax,) = figure.axes
    stored = stored_learning(ROOMS, label, 2, 300)
    new = [x.get_ydata() for x in ax.lines if x.get_color() == rerun.NEW]
    np.testing.assert_allclose(new, stored, atol=1e-6)
    assert ax.get_title(loc="left").endswith(": as stored")
    band = ax.collections[0].get_paths()[0].vertices
    assert band[:, 0].max() <= 600  # what a short run is beside, not all that is stored


def test_visits_and_numbers_of_sources_are_no_hindrance():
    # stored by torch, made again by the kernels, which round otherwise
    experiment = ROOMS_EXPLORATION
    made = rerun.rerun(experiment, ["NT"], 1, 100)["NT"]["learning"]
    np.testing.assert_allclose(made, stored_learning(experiment, "NT", 1, 100), atol=1e-3)
    assert len(Page(ROOMS_SOURCES).rerun(LABEL, runs=1, iterations=100).axes) == 1


@pytest.mark.parametrize(
    ("labels", "runs", "iterations"),
    [(["NT", "nothing"], 2, 500), (["NT"], 21, 500), (["NT"], 0, 500), (["NT"], 2, 99)],
)
def test_what_is_not_stored_is_refused_before_anything_is_made(
    monkeypatch, labels, runs, iterations
):
    monkeypatch.setattr(rerun, "run_batch", Mock(side_effect=AssertionError))
    with pytest.raises(ValueError, match=r"labels|runs|iterations"):
        rerun.rerun(ROOMS, labels, runs, iterations)


def test_an_interrupt_keeps_what_is_done(monkeypatch):
    """The kernel's interrupt comes while the second algorithm of three is at its second record."""
    inner, before = rerun.run_batch, signal.getsignal(signal.SIGINT)

    def made(experiment, label, runs, weights, progress, **how):
        def interrupted(t):
            if (label, t) == ("GVT", 200):
                sent = threading.Thread(target=os.kill, args=(os.getpid(), signal.SIGINT))
                sent.start()
                sent.join()
            return progress(t)

        return inner(experiment, label, runs, weights, interrupted, **how)

    monkeypatch.setattr(rerun, "run_batch", made)
    made = rerun.rerun(ROOMS, ["NT", "GVT", "1-MGVT"], 2, 1_000)
    assert {x: len(new["iterations"]) for x, new in made.items()} == {"NT": 10, "GVT": 2}
    stored = stored_learning(ROOMS, "GVT", 2, 200)
    np.testing.assert_allclose(made["GVT"]["learning"], stored, atol=1e-6)
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.parametrize("lambda_", [OWN.lambda_, 1e-2])
def test_settings_are_trained_and_compared_by_run(monkeypatch, lambda_):
    settings, batches = evolve(OWN, lambda_=lambda_), Mock(wraps=rerun.run_batch)
    monkeypatch.setattr(rerun, "run_batch", batches)
    text = try_settings(HERE, LABEL, settings, 2, 1_000)
    assert batches.call_args.kwargs == {"threads": processors()}
    head, *lines = text.replace("−", "-").splitlines()
    assert head == f"{LABEL}, 2 runs, mean learning return over 1,000 iterations"
    stored, yours, difference = (
        [float(x) for x in re.findall(r"[-+]?\d[\d.e-]*", line)] for line in lines
    )
    band = mean_interval(stored_learning(HERE, LABEL, 2, 1_000).mean(1))
    assert stored == pytest.approx([band.centre, band.low, band.high], rel=1e-2)
    assert difference[0] == pytest.approx(yours[0] - stored[0], abs=2e-3)
    same = settings == OWN
    assert (difference[0] == pytest.approx(0, abs=1e-3)) == same
    assert (yours == pytest.approx(stored, abs=1e-3)) == same


def test_processors_are_those_that_this_process_may_use_where_a_system_tells(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 5, 6}, raising=False)
    assert processors() == 3
    monkeypatch.delattr(os, "sched_getaffinity")
    assert processors() == os.cpu_count()
