"""A picture in lines has its curve where the axes of its frame say."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest
from xarray import Dataset

from vtbook.plots import look, returns_figure
from vtbook.setting_curves import Frame
from vtlab.stats import mean_interval

LIMITS = (0.0, 1.0)


def runs(level):
    """Returns of four runs about a level, of three records."""
    noise = np.random.default_rng(0).normal(0, 0.05, (4, 3))
    data = {"learning": (("run", "iteration"), level + noise), "optimum": ("run", [0.8] * 4)}
    return Dataset(data, {"iteration": [1_000, 2_000, 4_000]})


@pytest.fixture(scope="module")
def frame():
    with look():
        shown = {"NT": runs(0.2), "2-MGVT": runs(0.5)}
        figure = returns_figure(shown, LIMITS, {"learning return": "learning"}, 4.1)
        return Frame(figure, "a-frame", "2-MGVT")


def test_a_picture_has_its_curve_where_the_axes_of_its_frame_say(frame):
    stored = runs(0.4)
    svg = ElementTree.fromstring(frame.picture(stored, "its words"))
    assert svg.attrib["aria-label"] == "its words"
    assert svg.find("use").attrib["href"] == "#a-frame"
    band, line, dots = svg.findall("path")
    at = np.array(re.findall(r"[\d.]+", line.attrib["d"]), float).reshape(-1, 2)
    mean = mean_interval(stored.learning.values).centre
    # the same affine map takes iterations and returns to points, with returns upwards
    x = np.polyfit(stored.iteration.values, at[:, 0], 1)
    assert np.abs(np.polyval(x, stored.iteration.values) - at[:, 0]).max() < 0.1
    y = np.polyfit(mean, at[:, 1], 1)
    assert np.abs(np.polyval(y, mean) - at[:, 1]).max() < 0.1
    assert (x[0] > 0, y[0] < 0) == (True, True)
    ends = np.array(re.findall(r",([\d.]+)h0", dots.attrib["d"]), float)
    np.testing.assert_allclose(ends, np.polyval(y, stored.learning.values[:, -1]), atol=0.3)
    assert band.attrib["fill"] == line.attrib["stroke"]
