"""The page of an experiment: numbers for its text, and stored runs that are made again."""

import os
import signal
import threading
from unittest.mock import Mock

import numpy as np
import pytest

from vtbook import page as module
from vtbook.costs import cost
from vtbook.experiments.rooms import ROOMS_EVALUATION, ROOMS_EXPLORATION, ROOMS_SOURCES
from vtbook.page import RECORD, Page
from vtlab.store import returns, weights
from vtlib.stats import Interval


@pytest.fixture(scope="module")
def page():
    return Page(ROOMS_EVALUATION, "rooms-evaluation")


@pytest.fixture
def drawn(monkeypatch):
    """What each re-run has made, by label: the figures show no more than that."""
    made = {}
    inner = Page._over_stored

    def spied(self, new):
        made.update(new)
        return inner(self, new)

    monkeypatch.setattr(Page, "_over_stored", spied)
    return made


def titles(figure):
    return [ax.get_title(loc="left") for ax in figure.axes]


def test_a_page_has_the_stored_runs_of_both_protocols_and_the_published_curves(page):
    stored = returns(ROOMS_EVALUATION.published, "GVT")
    assert page.runs["GVT"].identical(stored)
    assert page.text["GVT"].identical(returns(ROOMS_EVALUATION.equations, "GVT"))
    assert page["GVT"].share(5_000).centre * page["GVT"].scale == pytest.approx(
        stored.learning.sel(iteration=5_000).values.mean()
    )
    assert page.runs is page.runs
    assert set(page.printed) == {"learning", "greedy"}
    assert set(page.printed["greedy"]) == {"NT", "GVT", "1-MGVT", "3-MGVT"}
    np.testing.assert_array_equal(page.weights, weights(ROOMS_EVALUATION.published.pool))
    found, used = page.cost("GVT"), page.experiment.sources
    assert found.saved == cost(page.sources, used, page.runs["GVT"], page.runs["NT"]).saved


@pytest.mark.parametrize(
    ("value", "form", "text"),
    [(-0.251, "z.1f", "−0.3"), (Interval(0.5, 0.25, 1), ".0%", "50% (25% to 100%)")],
)
def test_a_number_goes_to_the_text_as_the_book_finds_it_there(page, monkeypatch, value, form, text):
    shown = Mock()
    monkeypatch.setattr(module, "display", shown)
    page.say("name", value, form)
    shown.assert_called_once_with(
        {f"{RECORD}text/plain": f"'{text}'", "text/plain": f"name: {text}"},
        raw=True,
        metadata={"scrapbook": {"name": "name", "mime_prefix": RECORD}},
    )


def test_settings_are_told_with_what_the_results_took(page):
    html = page.settings().data
    assert "lambda_" in html
    for label in page.experiment.algorithms:
        assert f"rooms-evaluation/{label}" in html.replace("<span class='whole'>", "")


@pytest.mark.parametrize("label", ["NT", "GVT", "1-MGVT"])
def test_runs_made_again_are_the_stored_ones(page, drawn, label):
    figure = page.rerun(label, runs=2, iterations=300)
    stored = page.runs[label].isel(run=slice(2)).sel(iteration=slice(300))
    for kind in ("learning", "greedy"):
        np.testing.assert_allclose(drawn[label][kind], stored[kind].values, atol=1e-6)
    assert titles(figure)[0].endswith(" from stored")
    band = figure.axes[0].collections[0].get_paths()[0].vertices
    assert band[:, 0].max() <= 600  # what a short run is beside, not all that is stored
    lines = [x for x in figure.axes[0].lines if x.get_color() == module.NEW]
    assert [x.get_ydata().tolist() for x in lines] == drawn[label]["learning"].tolist()


def test_visits_and_numbers_of_sources_are_no_hindrance(drawn):
    # stored by torch, made again by the kernels, which round otherwise
    page = Page(ROOMS_EXPLORATION)
    page.rerun("NT", runs=1, iterations=100)
    stored = page.runs["NT"].learning.isel(run=[0]).sel(iteration=[100])
    np.testing.assert_allclose(drawn["NT"]["learning"], stored, atol=1e-3)
    label = "1-MGVT-from-2"
    assert len(Page(ROOMS_SOURCES).rerun(label, runs=1, iterations=100).axes) == 1
    assert drawn[label]["learning"].shape == (1, 2)


@pytest.mark.parametrize(
    ("labels", "wanted"),
    [
        (["nothing"], {}),
        (["NT", "nothing"], {}),
        (["NT"], {"runs": 21}),
        (["NT"], {"runs": 0}),
        (["NT"], {"iterations": 20_100}),
        (["NT"], {"iterations": 99}),
    ],
)
def test_what_is_not_stored_is_refused_before_anything_is_made(page, monkeypatch, labels, wanted):
    monkeypatch.setattr(module, "run_batch", Mock(side_effect=AssertionError))
    with pytest.raises(ValueError, match=r"labels|runs|iterations"):
        page.rerun(*labels, **wanted)


def test_an_interrupt_keeps_what_is_done(page, drawn, monkeypatch):
    """The kernel's interrupt comes while the second algorithm of three is at its second record."""
    inner, before = module.run_batch, signal.getsignal(signal.SIGINT)

    def made(experiment, label, *args, **how):
        runs, weights, progress = args

        def interrupted(t):
            if (label, t) == ("GVT", 200):
                sent = threading.Thread(target=os.kill, args=(os.getpid(), signal.SIGINT))
                sent.start()
                sent.join()
            return progress(t)

        return inner(experiment, label, runs, weights, interrupted, **how)

    monkeypatch.setattr(module, "run_batch", made)
    figure = page.rerun("NT", "GVT", "1-MGVT", runs=2, iterations=1_000)
    assert {x: len(new["iterations"]) for x, new in drawn.items()} == {"NT": 10, "GVT": 2}
    stored = page.runs["GVT"].learning.isel(run=slice(2)).sel(iteration=slice(200))
    np.testing.assert_allclose(drawn["GVT"]["learning"], stored, atol=1e-6)
    assert len(figure.axes) == 2
    assert signal.getsignal(signal.SIGINT) is before


def test_after_a_run_an_interrupt_means_what_it_meant_before(page):
    before = signal.getsignal(signal.SIGINT)
    with module.interruptible() as stopped:
        signal.raise_signal(signal.SIGINT)
        assert stopped.is_set()
    assert signal.getsignal(signal.SIGINT) is before
