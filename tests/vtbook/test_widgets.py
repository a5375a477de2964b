"""Sliders that reach the right picture, and the live panel: it trains, stops and recovers."""

import itertools
import threading
from unittest.mock import Mock

import ipywidgets as ui
import numpy as np
import pytest
from attrs import evolve
from xarray import Dataset

from vtbook import widgets
from vtbook.experiments import grids
from vtbook.experiments.protocols import transfer_settings
from vtbook.experiments.rooms import ROOMS_EVALUATION
from vtbook.widgets import Axis, LivePanel, parameter_axes, still_sliders

TINY = evolve(ROOMS_EVALUATION.equations, runs=3, sources=2, iterations=400, every=100)
MGVT = transfer_settings(TINY, "1-MGVT")
WEIGHTS = 0.1 * np.random.default_rng(0).random((50, TINY.family.q().d), dtype=np.float32)


def visible(widget):
    """The picture that nested stacks show."""
    while isinstance(widget, ui.Stack):
        widget = widget.children[widget.selected_index]
    return widget.value


def test_every_setting_of_the_sliders_shows_its_own_picture(monkeypatch):
    links, drawn = [], []
    monkeypatch.setattr(ui, "jsdlink", lambda *ends: links.append(ends))
    axes = [
        Axis(r"\(a\)", "the first", [("one", 1.0), ("two", 2.0), ("three", 3.0)], 2),
        Axis(r"\(b\)", "the second", [("low", 0.1), ("high", 0.9)], 1),
        Axis(r"\(c\)", "the third", [("x", "X"), ("y", "Y")], 0),
    ]
    *sliders, panel = still_sliders(axes, lambda *at: drawn.append(at) or f"{at}").children
    assert [(x.description, x.tooltip) for x in sliders] == [(x.label, x.name) for x in axes]
    assert visible(panel) == f"{tuple(x.value for x in sliders)}" == "(3.0, 0.9, 'X')"
    for indices in itertools.product(*(range(len(axis.options)) for axis in axes)):
        for slider, index in zip(sliders, indices, strict=True):
            slider.index = index
        for (source, name), (stack, other) in links:
            setattr(stack, other, getattr(source, name))
        values = tuple(axis.options[i][1] for axis, i in zip(axes, indices, strict=True))
        assert tuple(slider.value for slider in sliders) == values
        assert visible(panel) == f"{values}"
    assert len(drawn) == len(set(drawn))


def test_the_parameters_cover_the_stored_grid_around_the_thesis_setting():
    lambdas = grids.slider_lambdas(MGVT)
    axes = parameter_axes(grids.slider_thesis(TINY), lambdas)
    settings = itertools.product(*([value for _, value in axis.options] for axis in axes))
    stored = grids.sliders_of(TINY, "sliders", 2, 200).algorithms
    assert {grids.slider_name(*one) for one in settings} == set(stored)
    assert [text for text, _ in axes[0].options] == ["10⁻⁸", "10⁻⁷", "10⁻⁶", "10⁻⁵", "10⁻⁴"]
    for name, value in (("psi", 0.3), ("lambda_", 3e-4)):
        with pytest.raises(ValueError, match=f"{name} must be one of .*, got {value}"):
            parameter_axes({"1-MGVT": evolve(MGVT, **{name: value})}, lambdas)


def panel_of(experiment=TINY):
    """A panel over stored curves of two algorithms, and its parts by their words or kinds."""
    curve = ("run", "iteration"), np.random.default_rng(0).random((3, 4)) * 0.5
    data = {"learning": curve, "greedy": curve, "optimum": ("run", np.ones(3))}
    stored = Dataset(data, {"iteration": np.arange(100, 500, 100)})
    panel = LivePanel(experiment, WEIGHTS, {"NT": stored, "GVT": stored}, runs=2, iterations=200)
    above = panel.widget.children
    below = [part for whole in above for part in getattr(whole, "children", ())]
    each = (*above, *below)
    return panel, {getattr(x, "description", "") or type(x).__name__: x for x in each}


def trained(panel, parts):
    """What the panel says after a training."""
    parts["Run"].click()
    panel.wait()
    assert (parts["Run"].disabled, parts["Stop"].disabled) == (False, True)
    return parts["Label"].value


def quick(experiment, label, runs, *_):
    """What a training to the end would give, at once."""
    at = np.arange(experiment.every, experiment.iterations + 1, experiment.every)
    return {"iterations": at} | dict.fromkeys(("learning", "greedy"), np.ones((len(runs), len(at))))


@pytest.fixture
def figures(monkeypatch):
    """What draws the figures of a panel, and keeps what it was given."""
    kept = Mock(wraps=widgets.learning_figure)
    monkeypatch.setattr(widgets, "learning_figure", kept)
    return kept


def test_a_panel_shows_what_is_stored_then_trains_and_draws_until_it_is_stopped(
    figures, monkeypatch
):
    gate, real = threading.Event(), widgets.run_batch
    monkeypatch.setattr(widgets, "run_batch", lambda *call: gate.wait(30) and real(*call))
    panel, parts = panel_of()
    says, bar, before = parts["Label"], parts["progress"], parts["HTML"].value
    panel.wait()
    assert before.startswith('<img alt="Learning and greedy return of NT, GVT.')
    assert (says.value, parts["Stop"].disabled) == ("", True)
    parts["Run"].click()
    assert says.value == "training"
    assert (parts["Run"].disabled, parts["Stop"].disabled) == (True, False)
    panel.run()  # a second one during the first is ignored
    parts["Stop"].click()
    gate.set()
    panel.wait()
    assert says.value == "stopped at 100"
    assert trained(panel, parts) == "done at 200"
    assert bar.value == bar.max == 200
    assert parts["HTML"].value != before
    for number, call in enumerate(figures.call_args_list[1:], 1):
        for curves in call.args[0].values():
            assert [one.label for one in curves] == ["NT", "GVT", "1-MGVT, just now"]
            assert curves[-1].returns.shape == (2, number)


def test_a_panel_trains_what_its_sliders_say_on_the_stored_random_numbers(figures, monkeypatch):
    asked = Mock(side_effect=quick)
    monkeypatch.setattr(widgets, "run_batch", asked)
    panel, parts = panel_of(evolve(TINY, counts={"1-MGVT": 1}))
    for slider, index in zip(panel.widget.children, (4, 0, 2), strict=False):
        slider.index = index
    parts["sources"].value = 1
    trained(panel, parts)
    trained(panel, parts)
    for call in asked.call_args_list:
        experiment, label, runs, weights, _ = call.args
        assert experiment.algorithms == {label: evolve(MGVT, lambda_=1e-4, psi=0.0, components=2)}
        assert (experiment.sources_of(label), experiment.iterations) == (1, 200)
        assert (experiment.stream, list(runs)) == (TINY.stream, [0, 1])
        assert weights is WEIGHTS
    drawn = [call.args[0]["greedy return"] for call in figures.call_args_list]
    own = [[one.label for one in curves[2:]] for curves in drawn]
    assert own == [[], ["2-MGVT, just now"], ["2-MGVT, just now"]]


def test_any_error_is_shown_and_the_next_training_runs(monkeypatch):
    panel, parts = panel_of(evolve(TINY, every=300))
    before = parts["HTML"].value
    assert "every must be" in trained(panel, parts)
    parts["iterations"].value = 300
    monkeypatch.setattr(widgets, "run_batch", lambda *_: 1 / 0)
    assert trained(panel, parts) == "division by zero"
    assert parts["HTML"].value == before
    monkeypatch.setattr(widgets, "run_batch", quick)
    assert trained(panel, parts) == "done at 300"
