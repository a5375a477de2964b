"""Sliders for lambda, psi and the posterior: over pictures drawn beforehand, and live."""

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import ipywidgets as ui
import numpy as np
from attrs import evolve, frozen
from ipywidgets.widgets.widget_string import HTMLStyle
from xarray import Dataset

from vtbook import plots
from vtbook.experiments.grids import POSTERIORS, PSIS, slider_settings, slider_thesis
from vtbook.plots import Curve, figure_html, learning_figure, look, power_of_ten
from vtbook.rerun import NEW, Arrays, first_runs, interruptible
from vtlab.experiment import Experiment
from vtlib.transfer import Settings

# What works without a kernel must not wear JupyterLab's sign of a kernel that is missing.
UNSIGNED = """<style>.still.jupyter-widgets-disconnected::before,
.still .jupyter-widgets-disconnected::before { display: none !important; }</style>"""
LAMBDAS = (0.0, *(float(f"1e{power}") for power in range(-8, 0)))  # of the live panel


@functools.cache
def full() -> ui.Layout:
    """One layout for all widgets, made when there is a kernel that can tell pages of it."""
    return ui.Layout(width="100%")


@functools.cache
def plain() -> HTMLStyle:
    """One style for all pictures: of hundreds, each its own would make a tenth of a page."""
    return HTMLStyle()


@frozen
class Axis:
    """One slider: typeset label, spoken name, values with their texts, and where it starts."""

    label: str
    name: str
    options: Sequence[tuple[str, Any]]
    start: int


def parameter_axes(thesis: Mapping[str, Settings], lambdas: Sequence[float]) -> list[Axis]:
    """Sliders over lambda, psi and the posterior, which start at the thesis' 1-MGVT."""
    base = thesis["1-MGVT"]
    powers, shares = [(power_of_ten(x), x) for x in lambdas], [(f"{x:g}", x) for x in PSIS]
    kinds, spoken = [(x, x) for x in POSTERIORS], "posterior, a Gaussian or C components"
    return [
        Axis(r"\(\lambda\)", "lambda, weight of the KL term", powers, lambdas.index(base.lambda_)),
        Axis(r"\(\psi\)", "psi, share of the full gradient", shares, PSIS.index(base.psi)),
        Axis("posterior", spoken, kinds, POSTERIORS.index("1-MGVT")),
    ]


def still_sliders(
    axes: Sequence[Axis], picture: Callable[..., str], shared: Callable[[], str] | None = None
) -> ui.VBox:
    """Sliders over pictures drawn beforehand, which work without a kernel.

    picture(*values) gives the HTML of one grid point; shared, asked for after all of them, HTML of
    which they use parts. Pictures hang in nested stacks, one level per axis, and each slider is
    linked in the browser to every stack of its level.
    """
    levels: list[list[ui.Stack]] = [[] for _ in axes]

    def fill(depth: int, values: tuple[Any, ...]) -> ui.Widget:
        if depth == len(axes):
            return ui.HTML(picture(*values), layout=full(), style=plain())
        axis = axes[depth]
        children = [fill(depth + 1, (*values, value)) for _, value in axis.options]
        stack = ui.Stack(children, selected_index=axis.start, layout=full())
        levels[depth].append(stack)
        return stack

    panel = fill(0, ())
    sliders = []
    for axis, stacks in zip(axes, levels, strict=True):
        slider = _slider(axis)
        for stack in stacks:
            ui.jsdlink((slider, "index"), (stack, "selected_index"))
        sliders.append(slider)
    once = ui.HTML(UNSIGNED + (shared() if shared else ""))
    return ui.VBox([once, *sliders, panel], layout=full()).add_class("still")


def _slider(axis: Axis) -> ui.SelectionSlider:
    return ui.SelectionSlider(
        options=list(axis.options),
        index=axis.start,
        description=axis.label,
        tooltip=axis.name,
        layout=full(),
    )


def live_panel(
    experiment: Experiment,
    weights: np.ndarray,
    stored: Mapping[str, Dataset],
    runs: int = 5,
    iterations: int = 3_000,
) -> ui.VBox:
    """Sliders and a button that trains with their values and draws the curve over stored ones.

    The other parameters are those of the experiment's GVT and 1-MGVT; weights (count, d) are those
    of its pool; stored are returns by algorithm. The kernel's interrupt ends the training, and what
    was learned until then is drawn.
    """
    thesis = slider_thesis(experiment)
    sliders = [_slider(axis) for axis in parameter_axes(thesis, LAMBDAS)]
    numbers = [
        _number("runs", 2, runs, experiment.runs),
        _number("sources", 1, experiment.sources, experiment.sources),
        _number("iterations", 200, iterations, experiment.iterations),
    ]
    button = ui.Button(description="Run", button_style="primary")
    says, picture = ui.Label(), ui.HTML(layout=full())

    def draw(end: int, label: str = "", new: Arrays | None = None) -> None:
        """Draw the stored curves up to an iteration, and in each panel a new one."""
        panels = plots.panels({x: one.sel(iteration=slice(end)) for x, one in stored.items()})
        if new:
            for title, kind in plots.KINDS.items():
                panels[title].append(Curve(label, new["iterations"], new[kind], NEW))
        with look():
            limits = experiment.family.limits
            figure = learning_figure(panels, plots.mean_optimum(stored), limits)
            labels = ", ".join(filter(None, [*stored, label]))
            picture.value = figure_html(figure, f"Learning and greedy return of {labels}.")

    def train(_: ui.Button) -> None:
        setting = [slider.value for slider in sliders]
        count, sources, length = (number.value for number in numbers)
        button.disabled = True
        try:
            live = evolve(
                experiment,
                algorithms={"live": slider_settings(thesis, *setting)},
                counts={"live": sources},
            )
            with interruptible() as stopped:

                def progress(iteration: int) -> bool:
                    says.value = f"training, {iteration:,}"
                    return not stopped.is_set()

                new = first_runs(live, "live", count, length, weights, progress)
            end = int(new["iterations"][-1])
            draw(end, f"{setting[-1]}, just now", new)
            says.value = f"{'stopped' if stopped.is_set() else 'done'} at {end:,}"
        except Exception as error:  # what a button does has no cell that would show it
            says.value = str(error)
        finally:
            button.disabled = False

    button.on_click(train)
    draw(experiment.iterations)
    return ui.VBox([*sliders, ui.HBox([*numbers, button]), says, picture])


def _number(name: str, least: int, value: int, most: int) -> ui.BoundedIntText:
    return ui.BoundedIntText(value, min=least, max=most, description=name)
