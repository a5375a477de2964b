"""Plate diagrams: arrows meet borders, plates hold their nodes and cut no other, labels fit."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.patches import FancyArrowPatch

from vtlib.illustrations import plates
from vtlib.illustrations.plates import (
    FIXED,
    GAP,
    OBSERVED,
    RADIUS,
    SIDE,
    Diagram,
    Node,
    our_setting,
    plates_figure,
    several_classes,
    single_class,
)

DIAGRAMS = {
    "single class": single_class(),
    "several classes": several_classes(),
    "our setting": our_setting(),
}
each = pytest.mark.parametrize("diagram", DIAGRAMS.values(), ids=DIAGRAMS)


def on_border(node: Node, point: tuple[float, float]) -> bool:
    across, up = abs(point[0] - node.x), abs(point[1] - node.y)
    reach = max(across, up) - SIDE if node.kind == FIXED else math.hypot(across, up) - RADIUS
    return abs(reach) < 1e-9


def distance(node: Node, start: tuple[float, float], end: tuple[float, float]) -> float:
    """Of a node's centre from the segment between two points."""
    centre, a, b = (np.array(p) for p in ((node.x, node.y), start, end))
    share = np.clip((centre - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return float(np.linalg.norm(a + share * (b - a) - centre))


def overlap(first, second) -> bool:
    """Whether two boxes, each a lower left and an upper right corner, share an area."""
    return all(first[0][i] < second[1][i] and second[0][i] < first[1][i] for i in (0, 1))


def box_of(node: Node):
    half = node.half_width
    return (node.x - half, node.y - half), (node.x + half, node.y + half)


@each
def test_an_arrow_starts_and_ends_at_a_border(diagram: Diagram):
    for start, end in diagram.arrows:
        a, b = diagram.ends(start, end)
        assert on_border(diagram.nodes[start], a)
        assert on_border(diagram.nodes[end], b)
        # between the two nodes, not beyond them
        first, second = (diagram.nodes[name] for name in (start, end))
        apart = math.dist((first.x, first.y), (second.x, second.y))
        assert math.dist(a, b) < apart - 2 * SIDE + 1e-9


@pytest.mark.parametrize("kind", ["latent", OBSERVED, FIXED])
@pytest.mark.parametrize("at", [(3, 0), (-3, 0), (0, 2), (1, -4), (2, 2), (-5, 1)])
def test_a_border_point_lies_toward_the_other_node(kind: str, at: tuple[float, float]):
    node, other = Node("", 1.0, -1.0, kind), Node("", 1.0 + at[0], -1.0 + at[1])
    x, y = node.border(other)
    assert on_border(node, (x, y))
    assert (x - 1) * at[1] == pytest.approx((y + 1) * at[0])
    assert (x - 1) * at[0] + (y + 1) * at[1] > 0


@each
def test_no_arrow_crosses_a_node_that_it_does_not_join(diagram: Diagram):
    for arrow in diagram.arrows:
        ends = diagram.ends(*arrow)
        for name, node in diagram.nodes.items():
            if name not in arrow:
                assert distance(node, *ends) > RADIUS + 0.05, (arrow, name)


@each
def test_a_plate_holds_its_nodes_and_no_other(diagram: Diagram):
    for plate in diagram.plates:
        (left, low), (right, high) = diagram.box(plate)
        for name, node in diagram.nodes.items():
            (x0, y0), (x1, y1) = box_of(node)
            if name in plate.around:
                assert left < x0 < x1 < right
                assert low < y0 < y1 < high
            else:
                assert not overlap(box_of(node), diagram.box(plate)), (plate.label, name)


@each
def test_plates_and_nodes_are_apart(diagram: Diagram):
    boxes = [diagram.box(plate) for plate in diagram.plates]
    assert not any(overlap(a, b) for i, a in enumerate(boxes) for b in boxes[:i])
    nodes = list(diagram.nodes.values())
    assert not any(overlap(box_of(a), box_of(b)) for i, a in enumerate(nodes) for b in nodes[:i])


@each
def test_everything_is_within_the_bounds(diagram: Diagram):
    (left, low), (right, high) = diagram.bounds()
    for x0, y0 in [*map(box_of, diagram.nodes.values()), *map(diagram.box, diagram.plates)]:
        assert left < x0[0] < y0[0] < right
        assert low < x0[1] < y0[1] < high


def drawn(*diagrams: Diagram):
    """A drawn figure, and the extents of its labels in units of the diagrams."""
    figure = plates_figure(*diagrams)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    ax = figure.axes[0]
    back = ax.transData.inverted()
    labels = [
        (text.get_text(), back.transform_bbox(text.get_window_extent(canvas.get_renderer())))
        for text in ax.texts
        if text.get_text()
    ]
    return figure, labels


@each
def test_labels_are_inside_their_nodes_and_plates(diagram: Diagram):
    _, labels = drawn(replace(diagram, title=""))
    (left, _), _ = diagram.bounds()
    found = dict(labels)
    for node in diagram.nodes.values():
        label = found[node.label]
        corners = label.corners() - np.array([node.x - left, node.y])
        if node.kind == FIXED:
            assert np.abs(corners).max() < SIDE
        else:
            assert np.hypot(*corners.T).max() < RADIUS
    for plate in diagram.plates:
        (x0, y0), (x1, y1) = diagram.box(plate)
        label = found[plate.label]
        assert x0 - left < label.x0 < label.x1 < x1 - left
        assert y0 < label.y0 < label.y1 < y1
        for name in plate.around:
            corners = ((label.x0 + left, label.y0), (label.x1 + left, label.y1))
            assert not overlap(corners, box_of(diagram.nodes[name])), plate.label


@each
def test_no_arrow_crosses_a_plates_label(diagram: Diagram):
    _, labels = drawn(replace(diagram, title=""))
    (left, _), _ = diagram.bounds()
    found = dict(labels)
    for plate in diagram.plates:
        label = found[plate.label]
        for arrow in diagram.arrows:
            a, b = (np.array(point) for point in diagram.ends(*arrow))
            points = a + np.linspace(0, 1, 200)[:, None] * (b - a) - [left, 0]
            assert not (
                (points > [label.x0, label.y0]).all(1) & (points < [label.x1, label.y1]).all(1)
            ).any(), (plate.label, arrow)


def test_diagrams_side_by_side_keep_their_distance_and_their_titles():
    pair = DIAGRAMS["single class"], DIAGRAMS["several classes"]
    figure, labels = drawn(*pair)
    ax = figure.axes[0]
    widths = [right - left for (left, _), (right, _) in (d.bounds() for d in pair)]
    assert ax.get_xlim() == pytest.approx((0, sum(widths) + GAP))
    assert ax.get_aspect() == 1
    titles = [box for text, box in labels if text in {d.title for d in pair}]
    assert len(titles) == 2
    for title, start in zip(titles, (0, widths[0] + GAP), strict=True):
        assert title.x0 >= start
        assert title.y0 > max(high for _, (_, high) in (d.bounds() for d in pair))
        assert title.y1 < ax.get_ylim()[1]
    assert titles[0].x1 < widths[0]
    # nothing was drawn twice or left out
    arrows = [p for p in ax.patches if isinstance(p, FancyArrowPatch)]
    assert len(arrows) == sum(len(d.arrows) for d in pair)
    assert len(ax.texts) == sum(len(d.nodes) + len(d.plates) + 1 for d in pair)


def test_the_second_diagram_is_the_first_one_moved():
    once, _ = drawn(single_class())
    twice, _ = drawn(single_class(), single_class())
    count = len(once.axes[0].patches)
    first, second = twice.axes[0].patches[:count], twice.axes[0].patches[count:]
    (left, _), (right, _) = single_class().bounds()
    for a, b in zip(first, second, strict=True):
        moved = b.get_window_extent().x0 - a.get_window_extent().x0
        assert moved == pytest.approx((right - left + GAP) * plates.INCHES * twice.dpi, abs=0.01)


def test_what_is_observed_is_shaded():
    figure, _ = drawn(our_setting())
    circles = [p for p in figure.axes[0].patches if type(p).__name__ == "Circle"]
    shaded = {name for name, node in our_setting().nodes.items() if node.kind == OBSERVED}
    assert shaded == {"source weights", "transitions"}
    for circle, node in zip(circles, our_setting().nodes.values(), strict=True):
        assert (circle.get_facecolor()[:3] == (1, 1, 1)) == (node.kind != OBSERVED)
