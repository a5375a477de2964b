"""Return against the number of sources (section 6.1.5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
from matplotlib.figure import Figure

from vtlib.experiments.experiment import Experiment
from vtlib.experiments.reading import optimum, returns
from vtlib.experiments.rooms import SOURCE_COUNTS, count_name
from vtlib.plots import COLOURS, OPTIMUM, STYLES, BookFigure, look
from vtlib.stats import mean_interval

SHOWN = ("GVT", "1-MGVT", "2-MGVT")


def learning_at(experiment: Experiment, label: str, count: int, iteration: int) -> np.ndarray:
    """Learning return (R,) of an algorithm with so many sources at an iteration."""
    return returns(experiment.name, count_name(label, count)).at(iteration)


def counts_figure(
    experiment: Experiment,
    labels: Sequence[str],
    iterations: Sequence[int],
    dashed: Mapping[str, str] = MappingProxyType({}),
) -> Figure:
    """Learning return against the number of sources, at some iterations.

    dashed names, for some labels, a variant to be drawn dashed in the same colour.
    """
    with look():
        figure = BookFigure(figsize=(7.6, 3.5))
        axes = figure.subplots(1, len(iterations), sharey=True, squeeze=False)[0]
        shown = [(label, label, STYLES.get(label, "-")) for label in labels]
        shown += [(label, other, (0, (2, 1))) for label, other in dashed.items()]
        for ax, iteration in zip(axes, iterations, strict=True):
            for label, stored, style in shown:
                values = [learning_at(experiment, stored, n, iteration) for n in SOURCE_COUNTS]
                band = mean_interval(np.stack(values, 1))
                colour = COLOURS[label]
                ax.fill_between(SOURCE_COUNTS, band.low, band.high, color=colour, alpha=0.15, lw=0)
                ax.plot(SOURCE_COUNTS, band.centre, color=colour, ls=style, marker="o", ms=3.5)
                ax.lines[-1].set_label(stored)
            best = float(optimum(experiment.name).mean())
            ax.axhline(best, color=OPTIMUM, ls="--", lw=1.1, label="planned optimum")
            ax.set(
                title=f"after {iteration:,} iterations", xlabel="source tasks", ylim=(-0.02, 0.95)
            )
        axes[0].set_ylabel("learning return")
        handles, names = axes[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=5)
    return figure
