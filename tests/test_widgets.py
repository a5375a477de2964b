"""Sliders that reach the right picture, and the live panel: it trains, stops and recovers."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace

import ipywidgets as ui
import numpy as np
import pytest

from vtlib import widgets
from vtlib.domains import rooms_q
from vtlib.envs.rooms import RoomsFamily
from vtlib.experiments import ROOMS_SLIDERS, Experiment
from vtlib.experiments import runs as runs_of
from vtlib.experiments.experiment import COMPONENTS, PSIS, slider_lambdas, slider_name
from vtlib.experiments.rooms import MGVT
from vtlib.plots import Curve, curve
from vtlib.sources import Pool
from vtlib.training import Diverged
from vtlib.widgets import Axis, LivePanel, parameter_axes, still_sliders

TINY = Experiment(
    "tiny",
    Pool("tiny-pool", RoomsFamily(rooms=2), count=3),
    RoomsFamily(rooms=2),
    {"1-MGVT": MGVT},
    runs=3,
    sources=2,
    iterations=400,
    every=100,
)
WEIGHTS = 0.1 * np.random.default_rng(0).random((3, rooms_q().d), dtype=np.float32)
AXES = [
    Axis(r"\(a\)", "the first", [("one", 1.0), ("two", 2.0), ("three", 3.0)], 2),
    Axis(r"\(b\)", "the second", [("low", 0.1), ("high", 0.9)], 1),
]


Links = list[tuple[ui.SelectionSlider, ui.Stack]]


@pytest.fixture
def links(monkeypatch) -> Links:
    """Slider and stack of every link that the browser would keep."""
    made, real = [], ui.jsdlink

    def record(source, target):
        link = real(source, target)
        assert link.get_state()["_model_name"] == "DirectionalLinkModel"
        assert (source[1], target[1]) == ("index", "selected_index")
        made.append((link.source[0], link.target[0]))
        return link

    monkeypatch.setattr(ui, "jsdlink", record)
    return made


def set_slider(links: Links, slider: ui.SelectionSlider, index: int) -> None:
    """Move a slider and do what the browser's links do."""
    slider.index = index
    for source, stack in links:
        if source is slider:
            stack.selected_index = index


def visible(widget: ui.Widget) -> ui.HTML:
    """The picture that nested stacks show."""
    while isinstance(widget, ui.Stack):
        widget = widget.children[widget.selected_index]
    return widget


def picture(*values: float) -> str:
    return f"<img alt='{values}'>"


def parts(box: ui.VBox) -> tuple[list[ui.SelectionSlider], ui.Stack]:
    *sliders, panel = box.children
    return sliders, panel


@pytest.mark.parametrize("axes", [AXES, AXES[:1], [*AXES, AXES[0]]], ids=["two", "one", "three"])
def test_every_setting_of_the_sliders_shows_its_own_picture(axes, links):
    sliders, panel = parts(still_sliders(axes, picture))
    for indices in itertools.product(*(range(len(axis.options)) for axis in axes)):
        for slider, index in zip(sliders, indices, strict=True):
            set_slider(links, slider, index)
        values = tuple(axis.options[i][1] for axis, i in zip(axes, indices, strict=True))
        assert tuple(slider.value for slider in sliders) == values
        assert visible(panel).value == picture(*values)


def test_every_stack_is_linked_to_the_slider_of_its_level(links):
    sliders, panel = parts(still_sliders(AXES, picture))
    expected = {(id(sliders[0]), id(panel)), *((id(sliders[1]), id(s)) for s in panel.children)}
    assert {(id(slider), id(stack)) for slider, stack in links} == expected
    assert len(links) == 1 + 3


def test_sliders_and_stacks_start_where_the_axes_say():
    sliders, panel = parts(still_sliders(AXES, picture))
    assert [slider.index for slider in sliders] == [2, 1]
    assert panel.selected_index == 2
    assert [stack.selected_index for stack in panel.children] == [1, 1, 1]
    assert visible(panel).value == picture(3.0, 0.9)


def test_sliders_are_labelled():
    sliders, _ = parts(still_sliders(AXES, picture))
    assert [slider.description for slider in sliders] == [r"\(a\)", r"\(b\)"]
    assert [slider.tooltip for slider in sliders] == ["the first", "the second"]
    assert list(sliders[1].options) == [("low", 0.1), ("high", 0.9)]


def test_each_picture_is_drawn_once():
    drawn = []
    still_sliders(AXES, lambda *values: drawn.append(values) or picture(*values))
    assert sorted(drawn) == sorted(itertools.product((1.0, 2.0, 3.0), (0.1, 0.9)))


def test_the_parameters_cover_the_stored_grid_and_start_at_the_thesis_setting():
    axes = parameter_axes(MGVT)
    grid = [tuple(value for _, value in axis.options) for axis in axes]
    assert grid == [slider_lambdas(MGVT), PSIS, COMPONENTS]
    lambda_, psi, components = (axis.options[axis.start][1] for axis in axes)
    assert (lambda_, psi, components) == (MGVT.lambda_, MGVT.psi, MGVT.components)
    assert [text for text, _ in axes[0].options] == ["10⁻⁸", "10⁻⁷", "10⁻⁶", "10⁻⁵", "10⁻⁴"]
    assert [text for text, _ in axes[1].options] == ["0", "0.5", "1"]
    assert all(axis.label.startswith(r"\(") and axis.name for axis in axes)
    for values in itertools.product(*([v for _, v in axis.options] for axis in axes)):
        settings = ROOMS_SLIDERS.algorithms[slider_name(*values)]
        assert (settings.lambda_, settings.psi, settings.components) == values


def stored(*algorithms: str) -> dict[str, list[Curve]]:
    at, rng = np.arange(100, 500, 100), np.random.default_rng(0)
    return {
        name: [curve(a, a, at, rng.random((3, 4)) * 0.5) for a in algorithms]
        for name in ("learning return", "greedy return")
    }


def panel_of(experiment: Experiment = TINY, weights: np.ndarray = WEIGHTS) -> LivePanel:
    return LivePanel(experiment, MGVT, weights, stored("NT", "GVT"), 0.83, runs=2, iterations=200)


def everything(widget: ui.Widget) -> Iterator[ui.Widget]:
    yield widget
    for child in getattr(widget, "children", ()):
        yield from everything(child)


def part(panel: LivePanel, kind: type, description: str = "") -> ui.Widget:
    found = [w for w in everything(panel.widget) if type(w) is kind]
    return next(w for w in found if not description or w.description == description)


def assert_ready(panel: LivePanel) -> None:
    assert not part(panel, ui.Button, "Run").disabled
    assert part(panel, ui.Button, "Stop").disabled


@pytest.fixture
def drawn(monkeypatch) -> list[dict[str, list[Curve]]]:
    """The curves of every figure that a panel draws."""
    figures = []
    real = widgets.learning_figure

    def record(panels, *rest):
        figures.append(panels)
        return real(panels, *rest)

    monkeypatch.setattr(widgets, "learning_figure", record)
    return figures


@pytest.fixture
def held(monkeypatch) -> Iterator[Callable[[], None]]:
    """Training pauses before its first evaluation; calling the fixture lets it go on."""
    gate, real = threading.Event(), widgets.run_batch

    def wait_then_run(*arguments):
        assert gate.wait(30)
        return real(*arguments)

    monkeypatch.setattr(widgets, "run_batch", wait_then_run)
    yield gate.set
    gate.set()


def test_a_new_panel_shows_the_stored_curves_and_waits(drawn):
    panel = panel_of()
    assert [len(curves) for curves in drawn[0].values()] == [2, 2]
    assert part(panel, ui.HTML).value.startswith('<img alt="Learning and greedy return of')
    assert panel.message == ""
    assert_ready(panel)
    panel.wait()


def test_a_panel_trains_draws_and_says_so(drawn):
    panel = panel_of()
    before = part(panel, ui.HTML).value
    part(panel, ui.Button, "Run").click()
    panel.wait()
    assert panel.message == "done at 200"
    assert part(panel, ui.IntProgress).value == part(panel, ui.IntProgress).max == 200
    assert part(panel, ui.HTML).value != before
    (learning, greedy) = drawn[1].values()
    assert [one.label for one in learning] == ["NT", "GVT", "1-MGVT, just now"]
    assert learning[2].returns.shape == greedy[2].returns.shape == (2, 2)
    assert_ready(panel)


def quick(experiment: Experiment, label: str, runs: range, *_: object) -> dict[str, np.ndarray]:
    """What a training to the end would give, at once."""
    at = np.arange(experiment.every, experiment.iterations + 1, experiment.every)
    flat = np.ones((len(runs), len(at)))
    return {"iterations": at, "learning": 0.2 * flat, "greedy": 0.4 * flat}


def test_each_return_is_drawn_in_its_own_panel(drawn, monkeypatch):
    monkeypatch.setattr(widgets, "run_batch", quick)
    panel = panel_of()
    panel.run()
    panel.wait()
    learning, greedy = (curves[-1].returns for curves in drawn[1].values())
    assert (learning == 0.2).all()
    assert (greedy == 0.4).all()


def test_a_panel_trains_what_its_sliders_say_and_draws_anew_each_time(drawn, monkeypatch):
    asked = []
    real = widgets.run_batch

    def record(experiment, label, runs, *rest):
        asked.append((experiment, label, list(runs)))
        return real(experiment, label, runs, *rest)

    monkeypatch.setattr(widgets, "run_batch", record)
    panel = panel_of()
    *sliders, _, _, _, _ = panel.widget.children
    for slider, index in zip(sliders, (4, 0, 1), strict=True):
        slider.index = index
    for _ in range(2):
        panel.run()
        panel.wait()
        assert panel.message == "done at 200"
    (experiment, label, runs), again = asked
    assert again == (experiment, label, runs)
    settings = experiment.algorithms[label]
    assert settings == replace(MGVT, lambda_=1e-4, psi=0.0, components=2)
    assert (experiment.iterations, runs) == (200, [0, 1])
    # the stored experiment's own random numbers, so that the curves compare
    assert experiment.stream == TINY.stream
    one, two = (figure["learning return"] for figure in drawn[1:])
    assert one[-1].label == "2-MGVT, just now"
    assert [c.label for c in two] == [c.label for c in one]
    np.testing.assert_array_equal(two[-1].returns, one[-1].returns)


@pytest.fixture
def transferred(monkeypatch) -> list[np.ndarray]:
    """The sources (R, S, d) of every agent that is built."""
    sources, real = [], runs_of.VariationalTransfer

    def record(q, given, *rest):
        sources.append(given.numpy())
        return real(q, given, *rest)

    monkeypatch.setattr(runs_of, "VariationalTransfer", record)
    return sources


def test_a_panel_trains_with_so_many_sources(drawn, transferred):
    panel = panel_of()
    box = part(panel, ui.BoundedIntText, "sources")
    assert box.value == TINY.sources
    for count in (2, 1):
        box.value = count
        panel.run()
        panel.wait()
        assert panel.message == "done at 200"
    both, first = transferred
    assert both.shape == (2, 2, WEIGHTS.shape[1])
    # the run's own sources, one of them left out
    np.testing.assert_array_equal(first, both[:, :1])
    chosen = runs_of.chosen_sources(TINY, [0, 1])
    np.testing.assert_array_equal(both, WEIGHTS[chosen])


def test_a_panel_of_algorithms_with_counts_of_their_own_trains_with_all_sources(transferred):
    panel = panel_of(replace(TINY, counts={"1-MGVT": 1}))
    panel.run()
    panel.wait()
    assert panel.message == "done at 200"
    assert transferred[0].shape[1] == TINY.sources


@pytest.mark.parametrize(("asked", "given"), [(0, 1), (-3, 1), (1, 1), (2, 2), (9, 2)])
def test_a_panel_has_no_more_sources_than_its_runs(asked, given):
    box = part(panel_of(), ui.BoundedIntText, "sources")
    box.value = asked
    assert box.value == given


def test_stop_ends_a_training_at_its_next_evaluation_and_draws_it(drawn, held):
    panel = panel_of()
    panel.run()
    assert panel.message == "training"
    assert part(panel, ui.Button, "Run").disabled
    assert not part(panel, ui.Button, "Stop").disabled
    part(panel, ui.Button, "Stop").click()
    held()
    panel.wait()
    assert panel.message == "stopped at 100"
    assert drawn[1]["learning return"][-1].returns.shape == (2, 1)
    assert_ready(panel)


def test_a_stopped_panel_trains_again(monkeypatch):
    monkeypatch.setattr(widgets, "run_batch", quick)
    panel = panel_of()
    panel.stop()
    panel.run()
    panel.wait()
    assert panel.message == "done at 200"


def test_a_second_run_during_the_first_is_ignored(drawn, held):
    panel = panel_of()
    panel.run()
    panel.run()
    held()
    panel.wait()
    assert len(drawn) == 2
    assert panel.message == "done at 200"


def test_an_error_is_shown_and_the_buttons_come_back():
    panel = panel_of(weights=np.full_like(WEIGHTS, np.nan))
    before = part(panel, ui.HTML).value
    panel.run()
    panel.wait()
    assert panel.message == "weights of tiny-pool must be finite, got NaN or infinity"
    assert part(panel, ui.HTML).value == before
    assert_ready(panel)


def fails_with(error: BaseException) -> Callable[..., dict]:
    def fail(*_) -> dict:
        raise error

    return fail


@pytest.mark.parametrize(
    "error",
    [
        Diverged("run 1 of tiny, live diverged"),
        ValueError("psi must lie in [0, 1]"),
        RuntimeError("not enough memory"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_any_error_is_shown_and_the_next_training_runs(monkeypatch, error):
    panel = panel_of()
    with monkeypatch.context() as patched:
        patched.setattr(widgets, "run_batch", fails_with(error))
        panel.run()
        panel.wait()
    assert panel.message == str(error)
    assert_ready(panel)
    monkeypatch.setattr(widgets, "run_batch", quick)
    panel.run()
    panel.wait()
    assert panel.message == "done at 200"


def test_a_training_without_an_evaluation_recovers():
    panel = panel_of(replace(TINY, every=300))
    panel.run()
    panel.wait()
    assert_ready(panel)


def test_the_new_curve_is_told_apart_from_the_stored_one_of_its_algorithm(drawn, monkeypatch):
    monkeypatch.setattr(widgets, "run_batch", quick)
    panel = LivePanel(TINY, MGVT, WEIGHTS, stored("1-MGVT"), 0.83, runs=2, iterations=200)
    panel.run()
    panel.wait()
    old, new = drawn[1]["learning return"]
    assert (old.colour, old.style) != (new.colour, new.style)


@pytest.mark.parametrize(("runs", "iterations"), [(1, 200), (9, 100), (2, 9999)])
def test_numbers_out_of_range_are_brought_into_it(runs, iterations):
    panel = LivePanel(TINY, MGVT, WEIGHTS, stored("NT"), 0.83, runs=runs, iterations=iterations)
    assert 2 <= part(panel, ui.BoundedIntText, "runs").value <= TINY.runs
    assert 200 <= part(panel, ui.BoundedIntText, "iterations").value <= TINY.iterations
