"""Pictures of a slider that share all but one curve, in lines and letters."""

import re
from html import escape
from typing import Any

import numpy as np
from xarray import Dataset

from vtbook.plots import COLOURS, STYLES, BookFigure, drawn
from vtlab.stats import mean_interval


class Frame:
    """A figure of returns whose last curve each picture draws itself.

    name: that no other frame of the page has. ``symbol`` is the HTML that has to stand once on the
    page of the pictures.
    """

    def __init__(self, figure: BookFigure, name: str, label: str) -> None:
        (ax,) = figure.axes
        drawn(figure)  # which lays it out
        figure.set_layout_engine("none")
        own: Any = ax.collections[-1], ax.lines[len(ax.collections) - 1], ax.lines[-1]
        place: Any = ax.transData.frozen()
        self._at = place.transform
        self._scale = 72 / figure.dpi
        self._width, self._height = (float(x) for x in 72 * figure.get_size_inches())
        self._dots = float(own[2].get_xdata()[0])
        self._name, self._label = name, label
        for part in own:
            part.set_visible(False)
        self.symbol = self._drawn(figure)

    def picture(self, runs: Dataset, alt: str) -> str:
        """The figure with the learning returns of some runs for its last curve, as inline SVG."""
        at, values = runs.iteration.values, runs.learning.values
        band, colour = mean_interval(values), COLOURS[self._label]
        high, low = self._points(at, band.high), self._points(at, band.low)
        dash = STYLES.get(self._label, ())
        lengths = [1.8 * x for x in dash[1]] if isinstance(dash, tuple) and dash else []
        dashes = f' stroke-dasharray="{" ".join(f"{x:.2f}" for x in lengths)}"' if lengths else ""
        ends = self._points(np.full(len(values), self._dots), values[:, -1])
        dots = "".join(f"M{x:.1f},{y:.1f}h0" for x, y in ends)  # lines without length, round caps
        return (
            f'<svg class="curves" role="img" aria-label="{escape(alt)}" width="{self._width:.0f}pt"'
            f' viewBox="0 0 {self._width:.1f} {self._height:.1f}"><use href="#{self._name}"/>'
            f'<path d="{_path(np.concatenate([high, low[::-1]]))}z" fill="{colour}" opacity=".18"/>'
            f'<path d="{_path(self._points(at, band.centre))}" fill="none" stroke="{colour}"'
            f' stroke-width="1.8"{dashes}/><path d="{dots}" stroke="{colour}"'
            f' stroke-width="2.5" stroke-linecap="round" opacity=".5"/></svg>'
        )

    def _points(self, x: np.ndarray, y: np.ndarray | float) -> np.ndarray:
        """Places (T, 2) of data in the picture, in points from its upper left corner."""
        return np.array([0, self._height]) + [1, -1] * (self._at(np.stack([x, y], 1)) * self._scale)

    def _drawn(self, figure: BookFigure) -> str:
        whole = figure.svg("none")
        inside = whole[whole.index("<defs>") : whole.rindex("</svg>")]
        # it would hold for all pictures of the page, and here it is said of one
        inside = re.sub(r"<style.*?</style>", "", inside, flags=re.DOTALL)
        return (
            f'<svg class="frame" aria-hidden="true" width="0" height="0"><symbol id="{self._name}"'
            f' viewBox="0 0 {self._width:.1f} {self._height:.1f}"'
            f' style="stroke-linejoin: round; stroke-linecap: butt">{inside}</symbol></svg>'
        )


def _path(points: np.ndarray) -> str:
    """A path through places (T, 2), to a tenth of a point."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
