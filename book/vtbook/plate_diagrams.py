"""Plate diagrams: which quantity depends on which, what is observed, what is repeated."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle

from vtbook.plots import BookFigure

RADIUS, SIDE = 0.4, 0.56  # of a circle, of a square
MARGIN = 0.12  # around the drawing
INCHES = 0.85  # per unit
INK = "#222"

Point = tuple[float, float]


class Plate(NamedTuple):
    """A box from its lower left to its upper right corner, and its label's place from the first."""

    label: str
    low: Point
    high: Point
    label_at: Point = (0.1, 0.1)


class Diagram(NamedTuple):
    """Centres of the quantities by label, arrows from one label to another, and plates."""

    fixed: Mapping[str, Point]
    latent: Mapping[str, Point]
    observed: Mapping[str, Point]
    arrows: Sequence[tuple[str, str]]
    plates: Sequence[Plate]


def draw(ax: Axes, diagram: Diagram) -> None:
    """Draw a diagram in its own coordinates: squares are fixed, shaded circles are observed."""
    for label, (x, y), (right, high), (across, up) in diagram.plates:
        box = (x, y), right - x, high - y, "round,pad=0,rounding_size=0.12"
        ax.add_patch(FancyBboxPatch(*box, fc="none", ec="#8a8a8a", lw=1.1))
        ax.text(x + across, y + up, label, fontsize=13, math_fontfamily="stix")
    centres = {**diagram.fixed, **diagram.latent, **diagram.observed}
    borders: dict[str, Circle | Rectangle] = {}
    for label, (x, y) in centres.items():
        square = Rectangle((x - SIDE / 2, y - SIDE / 2), SIDE, SIDE)
        borders[label] = square if label in diagram.fixed else Circle((x, y), RADIUS)
        shade = "#d5dde6" if label in diagram.observed else "white"
        borders[label].set(fc=shade, ec=INK, lw=1.3)
        ax.add_patch(borders[label])
        ax.text(x, y, label, ha="center", va="center", fontsize=15, math_fontfamily="stix")
    for start, end in diagram.arrows:
        # The line between the centres is cut off where it meets the borders.
        ends = {"patchA": borders[start], "patchB": borders[end], "shrinkA": 0, "shrinkB": 0}
        style = {"arrowstyle": "-|>", "mutation_scale": 13, "lw": 1.2, "color": INK}
        ax.annotate("", centres[end], centres[start], arrowprops={**ends, **style})


def plates_figure(*diagrams: Diagram) -> Figure:
    """Diagrams in one drawing, on one scale."""
    figure = BookFigure()
    ax = figure.add_axes((0, 0, 1, 1))
    ax.set_axis_off()
    for diagram in diagrams:
        draw(ax, diagram)
    box = ax.dataLim.padded(MARGIN)
    ax.set(xlim=box.intervalx, ylim=box.intervaly)
    figure.set_size_inches(INCHES * box.width, INCHES * box.height)
    return figure
