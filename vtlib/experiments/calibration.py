"""How far a posterior can be believed: the figure of its coverage."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from vtlib.coverage import LEVELS
from vtlib.plots import COLOURS, STYLES, BookFigure, Curve, draw_curves, look


def coverage_figure(stored: Mapping[str, Mapping[str, np.ndarray]]) -> Figure:
    """Coverage over iterations of each algorithm's arrays, a panel for each level (dashed)."""
    with look():
        figure = BookFigure(figsize=(7.6, 3.2))
        axes = figure.subplots(1, len(LEVELS), sharey=True)
        for i, (ax, level) in enumerate(zip(axes, LEVELS, strict=True)):
            curves = [
                Curve(
                    label,
                    arrays["iterations"],
                    arrays["inside"][:, :, i],
                    COLOURS[label],
                    STYLES.get(label, "-"),
                )
                for label, arrays in stored.items()
            ]
            draw_curves(ax, curves)
            ax.axhline(level, color="black", ls="--", lw=1.1, label="calibrated")
            ax.set(title=f"{level:.0%} intervals", ylim=(0, 1))
        axes[0].set_ylabel("share of optimal values inside")
        handles, names = axes[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=5)
    return figure
