"""Sliders that reach the right picture, and the live panel: it trains, stops and recovers."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator
from typing import Any

import ipywidgets as ui
import numpy as np
import pytest
from attrs import evolve
from xarray import Dataset

from vtbook import widgets
from vtbook.experiments.grids import (
    POSTERIORS,
    PSIS,
    slider_lambdas,
    slider_name,
    slider_thesis,
    sliders_of,
)
from vtbook.experiments.rooms import GVT, MGVT
from vtbook.plots import Curve
from vtbook.widgets import Axis, LivePanel, parameter_axes, still_sliders
from vtlib.envs.rooms import RoomsFamily
from vtlib.experiments.experiment import Experiment, Pool
from vtlib.training import Diverged

FAMILY = RoomsFamily(rooms=2)
ALGORITHMS = {"GVT": GVT, "1-MGVT": MGVT}
POOL = Pool("tiny-pool", FAMILY, count=3)
TINY = Experiment("tiny", POOL, FAMILY, ALGORITHMS, 3, 2, iterations=400, every=100)
WEIGHTS = 0.1 * np.random.default_rng(0).random((3, FAMILY.q().d), dtype=np.float32)
AXES = [
    Axis(r"\(a\)", "the first", [("one", 1.0), ("two", 2.0), ("three", 3.0)], 2),
    Axis(r"\(b\)", "the second", [("low", 0.1), ("high", 0.9)], 1),
]


@pytest.fixture
def links(monkeypatch) -> list[tuple[ui.SelectionSlider, ui.Stack]]:
    """Slider and stack of every link that the browser would keep."""
    made, real = [], ui.jsdlink

    def record(source, target):
        assert (source[1], target[1]) == ("index", "selected_index")
        made.append((source[0], target[0]))
        return real(source, target)

    monkeypatch.setattr(ui, "jsdlink", record)
    return made


def visible(widget: ui.Widget) -> str:
    """The picture that nested stacks show."""
    while isinstance(widget, ui.Stack):
        widget = widget.children[widget.selected_index]
    return widget.value


@pytest.mark.parametrize("axes", [AXES, AXES[:1], [*AXES, AXES[0]]], ids=["two", "one", "three"])
def test_every_setting_of_the_sliders_shows_its_own_picture(axes, links):
    drawn = []
    *sliders, panel = still_sliders(axes, lambda *at: drawn.append(at) or f"{at}").children
    assert [(x.description, x.tooltip) for x in sliders] == [(x.label, x.name) for x in axes]
    start = tuple(axis.options[axis.start][1] for axis in axes)
    assert tuple(slider.value for slider in sliders) == start
    assert visible(panel) == f"{start}"
    for indices in itertools.product(*(range(len(axis.options)) for axis in axes)):
        for slider, index in zip(sliders, indices, strict=True):
            slider.index = index
            for source, stack in links:
                if source is slider:
                    stack.selected_index = index
        values = tuple(axis.options[i][1] for axis, i in zip(axes, indices, strict=True))
        assert tuple(slider.value for slider in sliders) == values
        assert visible(panel) == f"{values}"
    assert len(drawn) == len(set(drawn))


def test_the_parameters_cover_the_stored_grid_and_start_at_the_thesis_setting():
    thesis = slider_thesis(TINY)
    axes = parameter_axes(thesis, slider_lambdas(MGVT))
    grid = [tuple(value for _, value in axis.options) for axis in axes]
    assert grid == [slider_lambdas(MGVT), PSIS, POSTERIORS]
    assert [axis.options[axis.start][1] for axis in axes] == [MGVT.lambda_, MGVT.psi, "1-MGVT"]
    assert [text for text, _ in axes[0].options] == ["10⁻⁸", "10⁻⁷", "10⁻⁶", "10⁻⁵", "10⁻⁴"]
    assert {slider_name(*values) for values in itertools.product(*grid)} == {
        *sliders_of(TINY, "sliders", 2, 200).algorithms
    }
    for wrong in ({"psi": 0.3}, {"lambda_": 3e-4}):
        with pytest.raises(ValueError, match=f"{next(iter(wrong))} must be one of"):
            parameter_axes({"1-MGVT": evolve(MGVT, **wrong)}, slider_lambdas(MGVT))


def stored(*algorithms: str) -> dict[str, Dataset]:
    dims, values = ("run", "iteration"), np.random.default_rng(0).random((3, 4)) * 0.5
    data = {"learning": (dims, values), "greedy": (dims, values), "optimum": ("run", np.ones(3))}
    return {a: Dataset(data, {"iteration": np.arange(100, 500, 100)}) for a in algorithms}


def panel_of(experiment: Experiment = TINY, weights: np.ndarray = WEIGHTS) -> LivePanel:
    return LivePanel(experiment, weights, stored("NT", "GVT"), runs=2, iterations=200)


def parts(panel: LivePanel) -> dict[str, ui.Widget]:
    """The panel's parts by their description, those without one by their kind."""

    def everything(widget: ui.Widget) -> Iterator[ui.Widget]:
        yield widget
        for child in getattr(widget, "children", ()):
            yield from everything(child)

    return {getattr(w, "description", "") or type(w).__name__: w for w in everything(panel.widget)}


def said(panel: LivePanel) -> str:
    return parts(panel)["Label"].value


def trained(panel: LivePanel, wait: bool = True) -> LivePanel:
    parts(panel)["Run"].click()
    if wait:
        panel.wait()
        assert not parts(panel)["Run"].disabled
        assert parts(panel)["Stop"].disabled
    return panel


def quick(experiment: Experiment, label: str, runs: range, *_: object) -> dict[str, np.ndarray]:
    """What a training to the end would give, at once."""
    at = np.arange(experiment.every, experiment.iterations + 1, experiment.every)
    flat = np.ones((len(runs), len(at)))
    return {"iterations": at, "learning": 0.2 * flat, "greedy": 0.4 * flat}


@pytest.fixture
def drawn(monkeypatch) -> list[list[list[Curve]]]:
    """The curves of every figure that a panel draws, panel by panel."""
    figures, real = [], widgets.learning_figure

    def record(panels, *rest):
        figures.append(list(panels.values()))
        return real(panels, *rest)

    monkeypatch.setattr(widgets, "learning_figure", record)
    return figures


@pytest.fixture
def asked(monkeypatch) -> list[tuple[Any, ...]]:
    """What every training was asked for, each of which ends at once."""
    calls: list[tuple[Any, ...]] = []
    monkeypatch.setattr(widgets, "run_batch", lambda *call: calls.append(call) or quick(*call))
    return calls


@pytest.fixture
def held(monkeypatch) -> Iterator[Callable[[], None]]:
    """Training pauses before its first evaluation; calling the fixture lets it go on."""
    gate, real = threading.Event(), widgets.run_batch
    monkeypatch.setattr(widgets, "run_batch", lambda *call: gate.wait(30) and real(*call))
    yield gate.set
    gate.set()


def test_a_panel_shows_what_is_stored_then_trains_draws_and_says_so(drawn):
    panel = panel_of()
    panel.wait()
    before = parts(panel)["HTML"].value
    assert before.startswith('<img alt="Learning and greedy return of NT, GVT.')
    assert (said(panel), parts(panel)["Stop"].disabled) == ("", True)
    trained(panel)
    assert said(panel) == "done at 200"
    assert parts(panel)["progress"].value == parts(panel)["progress"].max == 200
    assert parts(panel)["HTML"].value != before
    for curves in drawn[1]:
        assert [one.label for one in curves] == ["NT", "GVT", "1-MGVT, just now"]
        assert curves[2].returns.shape == (2, 2)


def test_a_panel_trains_what_its_sliders_say_on_the_stored_random_numbers(drawn, asked):
    panel = panel_of(evolve(TINY, counts={"1-MGVT": 1}))
    for slider, index in zip(panel.widget.children, (4, 0, 2), strict=False):
        slider.index = index
    parts(panel)["sources"].value = 1
    trained(trained(panel))
    for experiment, label, runs, weights, _ in asked:
        assert experiment.algorithms == {label: evolve(MGVT, lambda_=1e-4, psi=0.0, components=2)}
        assert (experiment.sources_of(label), experiment.iterations) == (1, 200)
        assert (experiment.stream, list(runs)) == (TINY.stream, [0, 1])
        assert weights is WEIGHTS
    assert [len(figure[0]) for figure in drawn] == [2, 3, 3]
    assert drawn[2][0][-1].label == "2-MGVT, just now"


def test_stop_ends_a_training_at_its_next_evaluation_and_draws_it(drawn, held):
    panel = trained(panel_of(), wait=False)
    assert said(panel) == "training"
    assert (parts(panel)["Run"].disabled, parts(panel)["Stop"].disabled) == (True, False)
    panel.run()  # a second one during the first is ignored
    parts(panel)["Stop"].click()
    held()
    panel.wait()
    assert said(panel) == "stopped at 100"
    assert [figure[0][-1].returns.shape for figure in drawn[1:]] == [(2, 1)]
    trained(panel)
    assert said(panel) == "done at 200"


@pytest.mark.parametrize("error", [Diverged("run 1 diverged"), ValueError("psi"), OSError("full")])
def test_any_error_is_shown_and_the_next_training_runs(monkeypatch, error):
    def fail(*_: object) -> None:
        raise error

    panel = panel_of()
    monkeypatch.setattr(widgets, "run_batch", fail)
    assert said(trained(panel)) == str(error)
    monkeypatch.setattr(widgets, "run_batch", quick)
    assert said(trained(panel)) == "done at 200"


def test_weights_that_are_not_finite_and_a_run_without_an_evaluation_are_survived():
    before = parts(panel := panel_of(weights=np.full_like(WEIGHTS, np.nan)))["HTML"].value
    assert "must be finite" in said(trained(panel))
    assert parts(panel)["HTML"].value == before
    trained(panel_of(evolve(TINY, every=300)))
