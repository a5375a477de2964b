"""One look for every figure: a colour per algorithm, bands for intervals, a thin optimum."""

import io
import os
from base64 import b64encode
from collections.abc import Mapping
from functools import partial
from html import escape
from types import MappingProxyType
from typing import Any

import matplotlib as mpl
import numpy as np
from attrs import frozen
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.text import Text
from matplotlib.typing import LineStyleType
from PIL import Image
from xarray import Dataset

from vtbook.published import PublishedCurve
from vtlab.stats import mean_interval

# After Okabe and Ito: told apart with any colour vision, and seen on light pages and dark ones.
COLOURS = {
    "NT": "#6b6b6b",
    "DDQN": "#332288",
    "GVT": "#0072B2",
    "1-MGVT": "#D55E00",
    "2-MGVT": "#CC79A7",
    "3-MGVT": "#009E73",
    "fine-tuned": "#6c4824",
    "fine-tuned source": "#94793a",
    "fine-tuned mean": "#66002d",
    "trust": "#7b61ff",
}
PUBLISHED = "#8a8a8a"  # a published curve's band
# Its mean: dashed, since NT's is grey, too.
PRINTED: dict[str, Any] = {"color": "#4a4a4a", "lw": 0.9, "ls": (0, (4, 1.5))}
OPTIMUM = "#1a1a1a"
KINDS = MappingProxyType({"learning return": "learning", "greedy return": "greedy"})
# Line styles tell curves apart in print, and variants of one algorithm from it.
STYLES: dict[str, LineStyleType] = {
    "NT": (0, (1, 1)),
    "DDQN": (0, (3, 1, 1, 1, 1, 1)),
    "GVT": (0, (5, 1.5)),
    "2-MGVT": (0, (6.4, 1.6, 1, 1.6)),
    "3-MGVT": (0, (6, 1, 1, 1)),
    "fine-tuned": (0, (2, 1)),
    "fine-tuned source": (0, (2, 1, 1, 1)),
    "fine-tuned mean": (0, (8, 2)),
    "trust": (0, (12, 1)),
}
# Set where a figure that is cut off shall fail: in the book's build and the tests. A reader gets it
# as it is, for it may be the result of minutes.
CHECKED = "VTLIB_CHECK_FIGURES"
MOST_LINES = 150_000  # characters of a figure that is lines and letters
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
    """A figure that notebooks show by itself, without a plotting backend.

    It is shown in lines and letters where they are few, else as a picture.
    """

    def _repr_mimebundle_(self, **_: Any) -> dict[str, str | bytes]:
        raw = io.BytesIO()
        drawn(self).save(raw, format="png", dpi=2 * (STYLE["savefig.dpi"],))
        lines = self.svg()
        few = len(lines) <= MOST_LINES
        return {"image/svg+xml": lines} if few else {"image/png": raw.getvalue()}

    def svg(self, letters: str = "path") -> str:
        """The figure in lines; its letters as lines, too, or "none" for the reader's own font."""
        out = io.StringIO()
        # the same text whenever it is drawn
        with look(), mpl.rc_context({"svg.hashsalt": "vtbook", "svg.fonttype": letters}):
            FigureCanvasSVG(self).print_svg(out, metadata={"Date": None})
        return out.getvalue()


def drawn(figure: Figure) -> Image.Image:
    """The figure's picture, drawn once, where ``savefig`` would lay it out and draw it twice."""
    figure.set_dpi(STYLE["savefig.dpi"])
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    if os.environ.get(CHECKED):
        check_inside(figure)
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


def check_inside(figure: Figure) -> None:
    """Raise ValueError where a drawn figure's edge cuts off a text or a legend."""
    width, height = figure.bbox.width + 1, figure.bbox.height + 1
    parts = [*figure.texts, *figure.findobj(Legend)]
    for ax in figure.axes:
        labels = *ax.get_children(), ax.xaxis.label, ax.yaxis.label
        parts += [label for label in labels if isinstance(label, Text)]
    for part in parts:
        box = part.get_window_extent()
        if box.width and not (-1 <= box.x0 < box.x1 <= width and -1 <= box.y0 < box.y1 <= height):
            words = ", ".join(x.get_text() for x in part.findobj() if isinstance(x, Text))
            raise ValueError(f"cut off at the edge of its figure: {words}")


look = partial(mpl.rc_context, STYLE)  # draw inside this context to get the book's look


@frozen(eq=False)
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
    """Mean over runs with the 95 % interval shaded, and the planned optimum as a thin line."""
    for curve in curves:
        at, colour, band = curve.iterations, curve.colour, mean_interval(curve.returns)
        ax.fill_between(at, band.low, band.high, color=colour, alpha=0.18, lw=0)
        mark = "o" if len(at) == 1 else None  # a line needs two records
        look = dict[str, Any](color=colour, ls=curve.style, label=curve.label, marker=mark)
        ax.plot(at, band.centre, **look)
    if optimum is not None:
        ax.axhline(optimum, color=OPTIMUM, lw=0.8, label="planned optimum")
    ax.set_xlabel("thousand iterations")
    ax.xaxis.set_major_formatter(lambda x, _: f"{x / 1000:g}")
    ax.set_xlim(0, curves[0].iterations[-1])


def draw_ends(ax: Axes, curves: list[Curve]) -> None:
    """A dot for what each run earns in the end, right of the curves: a column for each of them."""
    last, dot = curves[0].iterations[-1], dict[str, Any](ms=5, mec="none")
    ax.axvline(last, color="0.85", lw=0.8)
    ax.plot([], [], ".", color="0.5", label="a run's end", **dot)
    for place, curve in enumerate(curves, 1):
        at = np.full(len(curve.returns), last * (1 + 0.03 * place))
        ax.plot(at, curve.returns[:, -1], ".", color=curve.colour, alpha=0.5, **dot)
    ax.set_xlim(0, last * (1 + 0.03 * (len(curves) + 1)))
    ax.set_xticks([x for x in ax.get_xticks() if x <= last])


def learning_figure(
    panels: Mapping[str, list[Curve]],
    optimum: float,
    limits: tuple[float, float],
    width: float = 7.6,
) -> BookFigure:
    """Panels side by side, such as learning and greedy return, with one legend below."""
    figure = BookFigure(figsize=(width, 3.5))
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for ax, (name, curves) in zip(axes, panels.items(), strict=True):
        draw_curves(ax, curves, optimum)
        draw_ends(ax, curves)
        ax.set_title(name)
        ax.set_ylim(*limits)
    axes[0].set_ylabel("discounted return")
    handles, labels = axes[0].get_legend_handles_labels()
    columns = 3 if width > 5 else 2
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)
    return figure


def panels(runs: Mapping[str, Dataset], kinds: Mapping[str, str] = KINDS) -> dict[str, list[Curve]]:
    """A panel of each algorithm's curves for each of its returns' kinds, by the panel's name."""
    return {
        title: [
            curve(label, label, stored.iteration.values, stored[kind].values)
            for label, stored in runs.items()
        ]
        for title, kind in kinds.items()
    }


def returns_figure(
    runs: Mapping[str, Dataset],
    limits: tuple[float, float],
    kinds: Mapping[str, str] = KINDS,
    width: float = 7.6,
) -> BookFigure:
    """Returns {algorithm: stored ones} with the mean optimum; a width in inches."""
    with look():
        return learning_figure(panels(runs, kinds), mean_optimum(runs), limits, width)


def draw_shares(
    ax: Axes, runs: Mapping[str, Dataset], places: Mapping[str, tuple[float, float]], title: str
) -> None:
    """Learning returns as shares of the mean optimum, with each name in its colour at a place."""
    shares = {label: stored.learning / mean_optimum(runs) for label, stored in runs.items()}
    curves = [curve(x, x, share.iteration.values, share.values) for x, share in shares.items()]
    draw_curves(ax, curves)
    for label, (x, y) in places.items():
        ax.text(x, y, label.replace("NT", "no transfer"), color=COLOURS[label])
    ax.yaxis.set_major_formatter(lambda y, _: f"{100 * y:.0f}%")
    ax.set(title=title, ylim=(-0.02, 1.02))
    ax.locator_params(axis="x", nbins=5)


def draw_over_published(
    ax: Axes, stored: Dataset, theirs: PublishedCurve, kind: str, label: str
) -> None:
    """One algorithm's mean and band over the published in grey, and every run while learning."""
    at, values = stored.iteration.values, stored[kind].values
    if kind == "learning":  # single greedy returns are of ten episodes: noise would hide the curves
        ax.plot(at, values.T, color=COLOURS[label], lw=0.4, alpha=0.3)
    ax.fill_between(theirs.iterations, theirs.low, theirs.high, color=PUBLISHED, alpha=0.4, lw=0)
    ax.plot(theirs.iterations, theirs.mean, **PRINTED)
    draw_curves(ax, [Curve(label, at, values, COLOURS[label])], float(stored.optimum.mean()))


def over_published(
    runs: Mapping[str, Dataset],
    printed: Mapping[str, Mapping[str, PublishedCurve]],
    limits: tuple[float, float],
    kinds: Mapping[str, str] = KINDS,
) -> Figure:
    """Each algorithm's mean and band over the published ones in grey, and every run while learning.

    printed: {kind: {algorithm: curve}}; there is a row of panels for each of the kinds.
    """
    labels = [x for x in runs if x in printed["learning"]]
    with look():
        figure = BookFigure(figsize=(7.6, 0.6 + 1.9 * len(kinds)))
        axes = figure.subplots(len(kinds), len(labels), sharex=True, sharey=True, squeeze=False)
        for row, (name, kind) in zip(axes, kinds.items(), strict=True):
            for ax, label in zip(row, labels, strict=True):
                draw_over_published(ax, runs[label], printed[kind][label], kind, label)
                ax.set_xlabel("")
            row[0].set_ylabel(name)
            row[0].set_ylim(*limits)
        for ax, label in zip(axes[0], labels, strict=True):
            ax.set_title(label, color=COLOURS[label])
        figure.supxlabel("thousand iterations", fontsize=10)
        return figure


def mean_optimum(runs: Mapping[str, Dataset]) -> float:
    """The mean planned optimum of algorithms that run on the same tasks."""
    return float(next(iter(runs.values())).optimum.mean())


def power_of_ten(value: float) -> str:
    """0, or a power of ten with its exponent raised, such as 10⁻⁶."""
    if value == 0:
        return "0"
    exponent = str(round(np.log10(value)))
    return "10" + exponent.translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def small_picture(figure: Figure, colours: int = 24) -> bytes:
    """The figure as a WebP of few colours: half the bytes of a PNG, for pages of many pictures."""
    out = io.BytesIO()
    # thirty times as fast as the median cut, and as near to the colours: there are few of them
    few = drawn(figure).quantize(colours, Image.Quantize.FASTOCTREE)
    few.convert("RGB").save(out, format="webp", lossless=True)
    return out.getvalue()


def figure_html(figure: Figure, alt: str, colours: int = 24) -> str:
    """An <img> element with a small picture of a figure and its description."""
    data = b64encode(small_picture(figure, colours)).decode()
    return f'<img alt="{escape(alt)}" style="max-width: 100%" src="data:image/webp;base64,{data}">'
