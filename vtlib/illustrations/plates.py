"""Plate diagrams: which quantity depends on which, what is observed, what is repeated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, FancyBboxPatch, Rectangle

from vtlib.plots import BookFigure

LATENT, OBSERVED, FIXED = "latent", "observed", "fixed"
RADIUS = 0.4  # of a circle
SIDE = 0.28  # half the side of a square
PADDING = 0.2  # between a node's border and its plate's
LABEL_ROOM = 0.36  # height of a plate's label, where it is below the nodes
BESIDE_ROOM = 1.05  # width of a plate's label, where it is beside them
MARGIN = 0.12  # around the whole
GAP = 0.5  # between diagrams
INCHES = 0.85  # per unit
FONT = 13

Point = tuple[float, float]


@dataclass(frozen=True)
class Node:
    """A quantity at (x, y): latent, observed (shaded), or a fixed number (a square)."""

    label: str
    x: float
    y: float
    kind: str = LATENT

    def border(self, toward: Node) -> Point:
        """The point of the border on the line to another node's centre."""
        across, up = toward.x - self.x, toward.y - self.y
        reach = max(abs(across), abs(up)) / SIDE if self.kind == FIXED else math.hypot(across, up)
        scale = (1.0 if self.kind == FIXED else RADIUS) / reach
        return self.x + scale * across, self.y + scale * up

    @property
    def half_width(self) -> float:
        """Distance from the centre to the rightmost point."""
        return SIDE if self.kind == FIXED else RADIUS


@dataclass(frozen=True)
class Plate:
    """A box around the named nodes: all in it exists once for each value of an index.

    Its label is in the lower left corner, or beside the nodes.
    """

    label: str
    around: tuple[str, ...]
    beside: bool = False


@dataclass(frozen=True)
class Diagram:
    """Nodes by name, the arrows between them as pairs of names, and plates."""

    title: str
    nodes: dict[str, Node]
    arrows: tuple[tuple[str, str], ...]
    plates: tuple[Plate, ...]

    def ends(self, start: str, end: str) -> tuple[Point, Point]:
        """Where an arrow leaves the border of one node and meets that of another."""
        first, second = self.nodes[start], self.nodes[end]
        return first.border(second), second.border(first)

    def box(self, plate: Plate) -> tuple[Point, Point]:
        """Lower left and upper right corner of a plate."""
        (left, low), (right, high) = _around([self.nodes[name] for name in plate.around])
        below, right = (0, right + BESIDE_ROOM) if plate.beside else (LABEL_ROOM, right)
        return (left - PADDING, low - PADDING - below), (right + PADDING, high + PADDING)

    def bounds(self) -> tuple[Point, Point]:
        """Lower left and upper right corner of everything."""
        corners = [_around(list(self.nodes.values())), *map(self.box, self.plates)]
        lows, highs = zip(*corners, strict=True)
        low = min(x for x, _ in lows) - MARGIN, min(y for _, y in lows) - MARGIN
        return low, (max(x for x, _ in highs) + MARGIN, max(y for _, y in highs) + MARGIN)


def _around(nodes: Sequence[Node]) -> tuple[Point, Point]:
    low = min(n.x - n.half_width for n in nodes), min(n.y - n.half_width for n in nodes)
    return low, (max(n.x + n.half_width for n in nodes), max(n.y + n.half_width for n in nodes))


def single_class() -> Diagram:
    """All tasks of one class (Lazaric and Ghavamzadeh, 2010): Figure 4.1a."""
    return Diagram(
        "(a) one class of tasks",
        {
            "hyper": Node(r"$\Omega$", 0.75, 4.3, FIXED),
            "weights' law": Node(r"$\mu, \Sigma$", 0.0, 2.95),
            "noise": Node(r"$\sigma^2$", 1.5, 2.95),
            "weights": Node("$w_m$", 0.0, 1.3),
            "rewards": Node("$r_m$", 1.5, 1.3, OBSERVED),
            "states": Node("$s_m$", 1.5, 0.1, OBSERVED),
        },
        (
            ("hyper", "weights' law"),
            ("hyper", "noise"),
            ("weights' law", "weights"),
            ("noise", "rewards"),
            ("weights", "rewards"),
            ("states", "rewards"),
        ),
        (Plate("$m = 1, …, M$", ("weights", "rewards", "states")),),
    )


def several_classes() -> Diagram:
    """Tasks of an unknown number of classes, by a Dirichlet process: Figure 4.1b."""
    return Diagram(
        "(b) several classes",
        {
            "base": Node("$G_0$", 0.0, 4.3, FIXED),
            "concentration": Node(r"$\tau$", 2.3, 4.3, FIXED),
            "class law": Node(r"$\theta_c$", 0.0, 2.95),
            "shares": Node("$v$", 2.3, 2.95),
            "weights": Node("$w_m$", 0.0, 1.3),
            "class": Node("$c_m$", 2.3, 1.3),
            "rewards": Node("$r_m$", 1.15, 0.1, OBSERVED),
            "states": Node("$s_m$", 2.3, 0.1, OBSERVED),
        },
        (
            ("base", "class law"),
            ("concentration", "shares"),
            ("class law", "weights"),
            ("class law", "rewards"),
            ("shares", "class"),
            ("class", "weights"),
            ("class", "rewards"),
            ("weights", "rewards"),
            ("states", "rewards"),
        ),
        (
            Plate("$c = 1, 2, …$", ("class law",), beside=True),
            Plate("$m = 1, …, M$", ("weights", "class", "rewards", "states")),
        ),
    )


def our_setting() -> Diagram:
    """The setting of the thesis (section 3.4): source weights and transitions are observed."""
    return Diagram(
        "",
        {
            "tasks' law": Node(r"$\mathcal{D}$", 1.3, 2.7),
            "source": Node(r"$\mathcal{M}_j$", 0.0, 1.5),
            "source weights": Node("$w_j$", 0.0, 0.2, OBSERVED),
            "target": Node(r"$\mathcal{M}_\tau$", 2.6, 1.5),
            "target weights": Node("$w$", 2.6, 0.2),
            "transitions": Node("$D$", 4.0, 0.2, OBSERVED),
        },
        (
            ("tasks' law", "source"),
            ("tasks' law", "target"),
            ("source", "source weights"),
            ("target", "target weights"),
            ("target", "transitions"),
        ),
        (Plate("$j = 1, …, S$", ("source", "source weights")),),
    )


def draw(ax: Axes, diagram: Diagram, shift: float = 0.0) -> None:
    """Draw a diagram on axes of equal scale, its left border at x = shift."""
    (left, _), _ = diagram.bounds()
    move = shift - left
    for plate in diagram.plates:
        (x, y), (right, high) = diagram.box(plate)
        size = right - x, high - y
        style = "round,pad=0,rounding_size=0.12"
        ax.add_patch(FancyBboxPatch((x + move, y), *size, style, fc="none", ec="#8a8a8a", lw=1.1))
        if plate.beside:
            x, y = right - BESIDE_ROOM - PADDING / 2, (y + high) / 2 - 0.1
        _write(ax, x + move + PADDING / 2, y + PADDING / 2, plate.label, fontsize=FONT)
    for start, end in diagram.arrows:
        points = [(x + move, y) for x, y in diagram.ends(start, end)]
        arrow = FancyArrowPatch(
            *points, arrowstyle="-|>", mutation_scale=13, shrinkA=0, shrinkB=0, lw=1.2, color="#222"
        )
        ax.add_patch(arrow)
    for node in diagram.nodes.values():
        ax.add_patch(_shape(node, move))
        _write(ax, node.x + move, node.y, node.label, ha="center", va="center", fontsize=FONT + 2)


def _write(ax: Axes, x: float, y: float, label: str, **look: Any) -> None:
    ax.text(x, y, label, math_fontfamily="stix", **look)


def _shape(node: Node, move: float) -> Circle | Rectangle:
    look: dict[str, Any] = {
        "fc": "#d5dde6" if node.kind == OBSERVED else "white",
        "ec": "#222",
        "lw": 1.3,
    }
    if node.kind == FIXED:
        return Rectangle((node.x + move - SIDE, node.y - SIDE), 2 * SIDE, 2 * SIDE, **look)
    return Circle((node.x + move, node.y), RADIUS, **look)


def plates_figure(*diagrams: Diagram) -> Figure:
    """Diagrams side by side, on one scale, each under its title."""
    corners = [diagram.bounds() for diagram in diagrams]
    widths = [right - left for (left, _), (right, _) in corners]
    low, high = min(y for (_, y), _ in corners), max(y for _, (_, y) in corners)
    shifts = [0.0, *accumulate(width + GAP for width in widths)]
    titled = any(diagram.title for diagram in diagrams)
    top = high + (0.5 if titled else 0.0)
    across = shifts[-1] - GAP
    figure = BookFigure(figsize=(INCHES * across, INCHES * (top - low)))
    ax = figure.add_axes((0, 0, 1, 1))
    ax.set(xlim=(0, across), ylim=(low, top), aspect="equal")
    ax.set_axis_off()
    for diagram, shift in zip(diagrams, shifts, strict=False):
        draw(ax, diagram, shift)
        ax.text(shift + MARGIN, high + 0.12, diagram.title, fontsize=FONT)
    return figure
