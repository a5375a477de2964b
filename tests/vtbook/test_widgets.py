"""The live panel: it trains, stops and recovers."""

import signal
from unittest.mock import Mock

import numpy as np
from attrs import evolve
from xarray import Dataset

from vtbook import rerun, widgets
from vtbook.experiments.protocols import transfer_settings
from vtbook.experiments.rooms import ROOMS_EVALUATION_EQUATIONS
from vtbook.widgets import live_panel
from vtlab.workers import processors

TINY = evolve(ROOMS_EVALUATION_EQUATIONS, runs=3, sources=2, iterations=400, every=100)
MGVT = transfer_settings(TINY, "1-MGVT")
WEIGHTS = 0.1 * np.random.default_rng(0).random((50, TINY.family.q().d), dtype=np.float32)


def panel_of(experiment=TINY):
    """A panel over stored curves of two algorithms: its sliders, and its other parts."""
    curve = ("run", "iteration"), np.random.default_rng(0).random((3, 4)) * 0.5
    data = {"learning": curve, "greedy": curve, "optimum": ("run", np.ones(3))}
    stored = Dataset(data, {"iteration": np.arange(100, 500, 100)})
    return parts_of(live_panel(experiment, WEIGHTS, {"NT": stored, "GVT": stored}, 2, 200))


def parts_of(panel):
    """The sliders of a panel, and its other parts by their words or kinds."""
    *sliders, below, says, picture = panel.children
    return sliders, {x.description: x for x in below.children} | {"says": says, "picture": picture}


def trained(parts):
    parts["Run"].click()
    assert not parts["Run"].disabled
    return parts["says"].value


def quick(experiment, label, runs, *_, **__):
    """What a training to the end would give, at once."""
    at = np.arange(experiment.every, experiment.iterations + 1, experiment.every)
    return {"iterations": at} | dict.fromkeys(("learning", "greedy"), np.ones((len(runs), len(at))))


def test_a_panel_shows_what_is_stored_then_trains_and_draws_until_it_is_interrupted(monkeypatch):
    inner, interrupted = rerun.run_batch, []

    def made(experiment, label, runs, weights, progress, **how):
        def once(t):
            assert parts["Run"].disabled
            if not interrupted:
                interrupted.append(t)
                signal.raise_signal(signal.SIGINT)
            return progress(t)

        return inner(experiment, label, runs, weights, once, **how)

    monkeypatch.setattr(rerun, "run_batch", made)
    figures = Mock(wraps=widgets.learning_figure)
    monkeypatch.setattr(widgets, "learning_figure", figures)
    _, parts = panel_of()
    before = parts["picture"].value
    assert before.startswith('<img alt="Learning and greedy return of NT, GVT.')
    assert trained(parts) == "stopped at 100"
    assert trained(parts) == "done at 200"
    assert parts["picture"].value != before
    for number, call in enumerate(figures.call_args_list[1:], 1):
        for curves in call.args[0].values():
            assert [one.label for one in curves] == ["NT", "GVT", "1-MGVT, just now"]
            assert {one.iterations[-1] for one in curves} == {100 * number}
            assert curves[-1].returns.shape == (2, number)


def test_a_panel_trains_what_its_sliders_say_on_the_stored_random_numbers(monkeypatch):
    asked = Mock(side_effect=quick)
    monkeypatch.setattr(rerun, "run_batch", asked)
    sliders, parts = panel_of(evolve(TINY, counts={"1-MGVT": 1}))
    for slider, value in zip(sliders, (1e-4, 0.0, "2-MGVT"), strict=True):
        slider.value = value
    parts["sources"].value = 1
    trained(parts)
    experiment, label, runs, given, _ = asked.call_args.args
    assert asked.call_args.kwargs == {"threads": processors()}
    assert experiment.algorithms == {label: evolve(MGVT, lambda_=1e-4, psi=0.0, components=2)}
    assert (experiment.sources_of(label), experiment.iterations) == (1, 200)
    assert (experiment.stream, list(runs)) == (TINY.stream, [0, 1])
    assert given is WEIGHTS
    assert "of NT, GVT, 2-MGVT, just now." in parts["picture"].value


def test_any_error_is_shown_and_the_next_training_runs(monkeypatch):
    _, parts = panel_of(evolve(TINY, every=300))
    before = parts["picture"].value
    assert "every must be" in trained(parts)
    assert parts["picture"].value == before
    parts["iterations"].value = 300
    monkeypatch.setattr(rerun, "run_batch", quick)
    assert trained(parts) == "done at 300"
