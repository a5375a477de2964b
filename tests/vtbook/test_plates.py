"""Plate diagrams of the pages: arrows meet borders, plates hold their nodes, labels fit."""

import math

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.patches import Circle, FancyBboxPatch
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

from vtbook.plates import RADIUS, SIDE


@pytest.fixture(params=[("related", "fig-hierarchies"), ("setting", "fig-setting")])
def ax(request, cells_of):
    name, figure = request.param
    FigureCanvasAgg(cells_of(name)[figure]).draw()
    return cells_of(name)[figure].axes[0]


def box(artist):
    """What an artist covers, in units of its diagram."""
    return artist.axes.transData.inverted().transform_bbox(artist.get_window_extent())


def depth(border, point):
    """How far within a border a point lies."""
    apart = np.abs(point - border.get_center())
    return RADIUS - math.hypot(*apart) if isinstance(border, Circle) else SIDE / 2 - max(apart)


def test_an_arrow_joins_two_borders_and_crosses_no_other_and_no_label(ax):
    borders = [patch for patch in ax.patches if not isinstance(patch, FancyBboxPatch)]
    labels = [box(text) for text in ax.texts if text.get_text()]
    for text in (x for x in ax.texts if isinstance(x, Annotation)):
        path = text.arrow_patch._get_path_in_displaycoord()[0][0].vertices
        line = ax.transData.inverted().transform(np.linspace(path[0], path[-1], 100))
        depths = np.array([[depth(border, point) for point in line] for border in borders])
        ends = depths[:, [0, -1]].argmax(0)
        assert ends[0] != ends[1]
        assert np.abs(depths[ends, [0, -1]]).max() < 0.03
        assert np.delete(depths, ends, 0).max() < -0.05
        assert not any(label.contains(*point) for label in labels for point in line)


def test_diagrams_are_within_the_figure(ax):
    drawn = Bbox.union([artist.get_window_extent() for artist in (*ax.patches, *ax.texts)])
    assert ax.bbox.x0 <= drawn.x0 <= drawn.x1 <= ax.bbox.x1
    assert ax.bbox.y0 <= drawn.y0 <= drawn.y1 <= ax.bbox.y1
