"""How far a posterior can be believed: the figure of its coverage."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from vtlib.coverage import LEVELS
from vtlib.plots import COLOURS, STYLES, BookFigure, Curve, draw_curves, look

TRUTHS = ("optimal values", "mellow values")  # as the probes store them


def coverage_figure(stored: Mapping[str, Mapping[str, np.ndarray]]) -> Figure:
    """Coverage over iterations of each algorithm's arrays: a row per truth, a panel per level."""
    with look():
        figure = BookFigure(figsize=(7.6, 5.0))
        axes = figure.subplots(len(TRUTHS), len(LEVELS), sharex=True, sharey=True)
        for (truth, i), ax in np.ndenumerate(axes):
            curves = [
                Curve(
                    label,
                    arrays["iterations"],
                    arrays["inside"][:, :, truth, i],
                    COLOURS[label],
                    STYLES.get(label, "-"),
                )
                for label, arrays in stored.items()
            ]
            draw_curves(ax, curves)
            ax.axhline(LEVELS[i], color="black", ls="--", lw=1.1, label="calibrated")
            ax.set(ylim=(0, 1), xlabel="thousand iterations" if truth else "")
            if not truth:
                ax.set_title(f"{LEVELS[i]:.0%} intervals")
        for ax, name in zip(axes[:, 0], TRUTHS, strict=True):
            ax.set_ylabel(f"{name} inside")
        handles, names = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=5)
    return figure
