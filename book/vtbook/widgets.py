"""Sliders for lambda, psi and the posterior: over pictures drawn beforehand, and live."""

import functools
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import ipywidgets as ui
import numpy as np
from attrs import evolve, frozen
from ipywidgets.widgets.widget_string import HTMLStyle
from xarray import Dataset

from vtbook import plots
from vtbook.experiments.grids import POSTERIORS, PSIS, slider_settings, slider_thesis
from vtbook.plots import Curve, image_html, learning_figure, look, power_of_ten, small_picture
from vtbook.rerun import NEW, first_runs
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


class LivePanel:
    """Train with chosen parameters and draw the new curve over stored ones, in JupyterLab.

    The other parameters are those of the experiment's GVT and 1-MGVT; weights (count, d) are those
    of its pool; stored are returns by algorithm. ``widget`` is what to display.
    ``run`` starts the training in a thread of its own and ``stop`` ends it at the next evaluation;
    what was learned until then is drawn.
    """

    def __init__(
        self,
        experiment: Experiment,
        weights: np.ndarray,
        stored: Mapping[str, Dataset],
        runs: int = 5,
        iterations: int = 3_000,
    ) -> None:
        self._experiment, self._weights = experiment, weights
        self._thesis = slider_thesis(experiment)
        self._stored, self._optimum = plots.panels(stored), plots.mean_optimum(stored)
        axes = parameter_axes(self._thesis, LAMBDAS)
        self._axes = [_slider(axis) for axis in axes]
        self._runs = _number("runs", 2, runs, experiment.runs)
        self._sources = _number("sources", 1, experiment.sources, experiment.sources)
        self._iterations = _number("iterations", 200, iterations, experiment.iterations)
        self._run = ui.Button(description="Run", button_style="primary")
        self._stop = ui.Button(description="Stop", disabled=True)
        self._bar = ui.IntProgress(0, 0, iterations, description="progress")
        self._says = ui.Label()
        self._picture = ui.HTML(layout=full())
        self._halt = threading.Event()
        self._thread: threading.Thread | None = None
        self._run.on_click(lambda _: self.run())
        self._stop.on_click(lambda _: self.stop())
        numbers = ui.HBox([self._runs, self._sources, self._iterations, self._run, self._stop])
        self.widget = ui.VBox([*self._axes, numbers, self._bar, self._says, self._picture])
        self._draw()

    def run(self) -> None:
        """Start training with the panel's values, unless it is training."""
        if self._thread is not None and self._thread.is_alive():
            return
        self._halt.clear()
        self._bar.max, self._bar.value = self._iterations.value, 0
        self._run.disabled, self._stop.disabled, self._says.value = True, False, "training"
        self._thread = threading.Thread(target=self._train, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the training at its next evaluation."""
        self._halt.set()

    def wait(self) -> None:
        """Return when the training has ended."""
        if self._thread is not None:
            self._thread.join()

    def _train(self) -> None:
        try:
            setting = [slider.value for slider in self._axes]
            live = evolve(
                self._experiment,
                algorithms={"live": slider_settings(self._thesis, *setting)},
                counts={"live": self._sources.value},
            )
            size = self._runs.value, self._iterations.value
            arrays = first_runs(live, "live", *size, self._weights, self._progress)
            label, at = f"{setting[-1]}, just now", arrays["iterations"]
            self._draw([Curve(label, at, arrays[kind], NEW) for kind in plots.KINDS.values()])
            self._says.value = f"{'stopped' if self._halt.is_set() else 'done'} at {at[-1]:,}"
        except Exception as error:  # nobody else would see it: this is a thread of its own
            self._says.value = str(error)
        finally:
            self._run.disabled, self._stop.disabled = False, True

    def _progress(self, iteration: int) -> bool:
        self._bar.value = iteration
        return not self._halt.is_set()

    def _draw(self, new: Sequence[Curve] = ()) -> None:
        """Draw the stored curves, and in each panel a new one, up to where that ends."""
        stored = self._stored.items()
        end = new[0].iterations[-1] if new else self._experiment.iterations
        panels = {
            title: [*(curve.until(end) for curve in curves), *new[i : i + 1]]
            for i, (title, curves) in enumerate(stored)
        }
        with look():
            limits = self._experiment.family.limits
            picture = small_picture(learning_figure(panels, self._optimum, limits))
        labels = ", ".join(curve.label for curve in next(iter(panels.values())))
        self._picture.value = image_html(picture, f"Learning and greedy return of {labels}.")


def _number(name: str, least: int, value: int, most: int) -> ui.BoundedIntText:
    return ui.BoundedIntText(value, min=least, max=most, description=name)
