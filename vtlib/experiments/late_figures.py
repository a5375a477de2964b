"""Why transfer to a cartpole falls late: returns, and the runs whose posterior's spread grows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.typing import LineStyleType

from vtlib.experiments.control import LATE_VARIANTS
from vtlib.experiments.experiment import Experiment
from vtlib.experiments.figures import limits_of
from vtlib.experiments.probes import StabilityProbe
from vtlib.experiments.protocol import html_table
from vtlib.experiments.reading import optimum
from vtlib.experiments.runs import prepare
from vtlib.experiments.work import load_result
from vtlib.plots import COLOURS, BookFigure, Curve, draw_curves, look
from vtlib.store import Arrays, results_folder

EXPLODED = 100.0  # a spread has exploded that is so many times its first value
FALLEN = 0.9  # of the optimum; a run has fallen that ends below it
LATE_COLOURS = dict(zip(LATE_VARIANTS, ("#1a1a1a", "#66a61e", "#7570b3", "#b2182b"), strict=True))
DASHES: tuple[LineStyleType, ...] = ("-", (0, (5, 1.5)), "-.", (0, (1, 1)))
LATE_STYLES = dict(zip(LATE_VARIANTS, DASHES, strict=True))
MARKERS = {"GVT": "o", "1-MGVT": "^"}
THESIS = next(iter(LATE_VARIANTS))
STEP = "step on $L$ over its bound"


class Outcomes(NamedTuple):
    """Whether (R,) a run's step on L came above its bound, its spread exploded, its return fell."""

    above: np.ndarray
    exploded: np.ndarray
    fallen: np.ndarray


def late_runs(experiment: Experiment) -> dict[tuple[str, str], Arrays]:
    """Stored arrays of every algorithm and variant."""
    return {
        (label, name): load_result(experiment.name, f"{label}, {name}", results_folder())[0]
        for label in MARKERS
        for name in LATE_VARIANTS
    }


def growth(arrays: Mapping[str, np.ndarray]) -> np.ndarray:
    """How many times each run's last spread of values is its first, (R,)."""
    spread = arrays["spread"]
    times: np.ndarray = spread[:, -1] / spread[:, 0]
    return times


def intact(arrays: Mapping[str, np.ndarray]) -> np.ndarray:
    """At which looks a run's spread has not exploded yet, (R, T)."""
    spread = arrays["spread"]
    return np.logical_and.accumulate(spread <= EXPLODED * spread[:, :1], axis=1)


def largest_step(arrays: Mapping[str, np.ndarray]) -> np.ndarray:
    """Largest step on L of each run, over the largest stable one, while it is intact, (R,)."""
    largest: np.ndarray = np.where(intact(arrays), arrays["step"], -np.inf).max(1)
    return largest


def outcomes(experiment: Experiment, arrays: Mapping[str, np.ndarray]) -> Outcomes:
    """What became of the runs of an algorithm and variant of an experiment."""
    best = optimum(experiment.name)[arrays["run"]]
    fallen = arrays["learning"][:, -1] < FALLEN * best
    return Outcomes(largest_step(arrays) > 1, growth(arrays) > EXPLODED, fallen)


def all_outcomes(experiment: Experiment) -> Outcomes:
    """What became of the runs of all algorithms and variants."""
    each = [outcomes(experiment, arrays) for arrays in late_runs(experiment).values()]
    return Outcomes(*(np.concatenate(x) for x in zip(*each, strict=True)))


def bound_table(experiments: Mapping[str, Experiment]) -> str:
    """How well the bound foretells what becomes of runs, as an HTML table; a column for each."""
    columns = []
    for experiment in experiments.values():
        above, exploded, fallen = all_outcomes(experiment)
        counted = (above, above & exploded, ~above, ~above & exploded, fallen, fallen & exploded)
        columns.append([str(len(above)), *(str(int(which.sum())) for which in counted)])
    names = [
        "runs",
        "whose step comes above the bound",
        "of these, the posterior explodes in",
        "whose step stays below the bound",
        "of these, the posterior explodes in",
        f"that end below {FALLEN:.0%} of the optimum",
        "of these, the posterior has exploded in",
    ]
    return html_table(["", *experiments], [list(row) for row in zip(names, *columns, strict=True)])


def step_after(experiment: Experiment, label: str, iterations: int, pool: np.ndarray) -> float:
    """The step on L over the largest stable one in the first run, computed anew.

    pool (count, d) are the weights of the experiment's sources.
    """
    settings = experiment.transfer_settings(label)
    probed = replace(experiment, algorithms={label: settings}, counts={}, probes=settings.batch)
    batch = prepare(experiment, label, settings, [0], pool)
    probe = StabilityProbe(probed, [0], settings)
    for _ in batch.moments([iterations]):
        probe.look(batch.agent)
    return float(probe.arrays["step"][0, 0])


def late_figure(experiment: Experiment, again: Experiment) -> Figure:
    """Learning return of each algorithm and variant; steps over time, and growth by steps.

    The last panel has the runs of both experiments, those of the second as full marks.
    """
    stored = late_runs(experiment)
    best = float(optimum(experiment.name).mean())
    with look():
        figure = BookFigure(figsize=(7.6, 6.0))
        axes = figure.subplots(2, 2)
        for ax, label in zip(axes[0], MARKERS, strict=True):
            draw_curves(ax, [_curve(name, stored[label, name]) for name in LATE_VARIANTS], best)
            ax.set(title=label, ylim=limits_of(experiment), ylabel="learning return")
        _draw_steps(axes[1, 0], stored)
        _draw_growth(axes[1, 1], stored, {"mfc": "none"})
        _draw_growth(axes[1, 1], late_runs(again), {"mew": 0})
        handles, names = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=3)
    return figure


def _curve(name: str, arrays: Arrays) -> Curve:
    colour, style = LATE_COLOURS[name], LATE_STYLES[name]
    return Curve(name, arrays["iterations"], arrays["learning"], colour, style)


def _draw_steps(ax: Axes, stored: Mapping[tuple[str, str], Arrays]) -> None:
    """The steps of the thesis' runs as long as they are intact, with a dot where they explode."""
    for label, marker in MARKERS.items():
        arrays = stored[label, THESIS]
        for step, whole in zip(arrays["step"], intact(arrays), strict=True):
            last = whole.sum() - 1
            times = arrays["iterations"][: last + 1]
            ax.plot(times, step[: last + 1], color=COLOURS[label], lw=0.9, alpha=0.7)
            if not whole.all():
                ax.plot(times[-1], step[last], marker, color=COLOURS[label], ms=6)
    ax.axhline(1, color="black", lw=0.8, ls=":")
    ax.set(title=f"runs {THESIS}", xlabel="thousand iterations", ylabel=STEP, ylim=(0, 2))
    ax.xaxis.set_major_formatter(lambda x, _: f"{x / 1000:g}")


def _draw_growth(
    ax: Axes, stored: Mapping[tuple[str, str], Arrays], mark: Mapping[str, Any]
) -> None:
    for (label, name), arrays in stored.items():
        style = {"color": LATE_COLOURS[name], "ms": 5, "alpha": 0.75, "ls": "", **mark}
        ax.loglog(largest_step(arrays), growth(arrays), MARKERS[label], **style)
    ax.axvline(1, color="black", lw=0.8, ls=":")
    ax.set(title="all runs", xlabel=f"largest {STEP}", ylabel="growth of the spread")
