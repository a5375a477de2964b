"""One look for every figure: a colour per algorithm, bands for intervals, the optimum dashed."""

from __future__ import annotations

import io
from base64 import b64encode
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.typing import LineStyleType
from PIL import Image

from vtlib.stats import mean_interval

# Okabe and Ito's palette, told apart with any colour vision.
COLOURS = {
    "NT": "#6b6b6b",
    "DDQN": "#332288",
    "GVT": "#0072B2",
    "1-MGVT": "#D55E00",
    "2-MGVT": "#CC79A7",
    "3-MGVT": "#009E73",
}
OPTIMUM = "#1a1a1a"
# Line styles tell curves apart in print, and variants of one algorithm from it.
STYLES: dict[str, LineStyleType] = {
    "NT": (0, (1, 1)),
    "DDQN": (0, (3, 1, 1, 1, 1, 1)),
    "GVT": (0, (5, 1.5)),
    "2-MGVT": "-.",
    "3-MGVT": (0, (6, 1, 1, 1)),
}
STYLE: dict[Any, Any] = {  # by matplotlib's names of its settings
    "figure.facecolor": "white",
    "figure.dpi": 110,
    "savefig.dpi": 144,
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "lines.linewidth": 1.8,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "figure.constrained_layout.use": True,
}


class BookFigure(Figure):
    """A figure that notebooks show by itself, without a plotting backend."""

    def _repr_png_(self) -> bytes:
        return png(self)


@contextmanager
def look() -> Iterator[None]:
    """Draw inside this context to get the book's look."""
    with mpl.rc_context(STYLE):
        yield


@dataclass(frozen=True)
class Curve:
    """Returns (R, T) of R runs at iterations (T,), drawn as one line with its band."""

    label: str
    iterations: np.ndarray
    returns: np.ndarray
    colour: str
    style: LineStyleType = "-"


def curve(label: str, algorithm: str, iterations: np.ndarray, returns: np.ndarray) -> Curve:
    """A curve in its algorithm's colour and line style."""
    return Curve(label, iterations, returns, COLOURS[algorithm], STYLES.get(algorithm, "-"))


def draw_curves(ax: Axes, curves: list[Curve], optimum: float | None = None) -> None:
    """Mean over runs with the 95 % interval shaded, and the planned optimum dashed."""
    for one in curves:
        band = mean_interval(one.returns)
        ax.fill_between(one.iterations, band.low, band.high, color=one.colour, alpha=0.18, lw=0)
        ax.plot(one.iterations, band.centre, color=one.colour, ls=one.style, label=one.label)
    if optimum is not None:
        ax.axhline(optimum, color=OPTIMUM, ls="--", lw=1.1, label="planned optimum")
    ax.set_xlabel("thousand iterations")
    ax.xaxis.set_major_formatter(lambda x, _: f"{x / 1000:g}")
    ax.set_xlim(0, curves[0].iterations[-1])


def learning_figure(
    panels: Mapping[str, list[Curve]],
    optimum: float,
    limits: tuple[float, float],
    title: str = "",
) -> Figure:
    """Panels side by side, such as learning and greedy return, with one legend below."""
    figure = BookFigure(figsize=(7.6, 3.5))
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for ax, (name, curves) in zip(axes, panels.items(), strict=True):
        draw_curves(ax, curves, optimum)
        ax.set_title(name)
        ax.set_ylim(*limits)
    axes[0].set_ylabel("discounted return")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(5, len(labels)))
    if title:
        figure.suptitle(title, x=0.01, ha="left", fontsize=10)
    return figure


def png(figure: Figure) -> bytes:
    """The figure as a PNG, twice as fine as a page is wide."""
    raw = io.BytesIO()
    figure.savefig(raw, format="png", dpi=STYLE["savefig.dpi"])
    return raw.getvalue()


def power_of_ten(value: float) -> str:
    """A power of ten with its exponent raised, such as 10⁻⁶."""
    exponent = str(round(np.log10(value)))
    return "10" + exponent.translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def small_png(figure: Figure, colours: int = 64) -> bytes:
    """The figure as a PNG with a palette: a tenth of the bytes, for pages with many pictures."""
    # drawn once; saving as a PNG first would draw it twice and encode it for nothing
    figure.set_dpi(STYLE["savefig.dpi"])
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB").quantize(colours)
    out = io.BytesIO()
    picture.save(out, format="png", optimize=True)
    return out.getvalue()


def image_html(png: bytes, alt: str) -> str:
    """An <img> element that carries its picture and its description."""
    text = alt.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    source = f"data:image/png;base64,{b64encode(png).decode()}"
    return f'<img alt="{text}" style="max-width: 100%" src="{source}">'
