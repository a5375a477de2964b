"""One look: colours told apart by every eye, and figures that carry what a reader needs."""

from __future__ import annotations

import io
import itertools
import re
from base64 import b64decode
from html.parser import HTMLParser

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from PIL import Image

from vtlib.experiments import EXPERIMENTS
from vtlib.experiments.control_figures import VARIANTS
from vtlib.plots import (
    COLOURS,
    OPTIMUM,
    STYLES,
    Curve,
    curve,
    draw_curves,
    image_html,
    learning_figure,
    look,
    small_png,
)
from vtlib.stats import mean_interval

ITERATIONS = np.arange(100, 1100, 100)
# Full dichromacy, acting on linear RGB: Machado, Oliveira and Fernandes (2009), table 1.
VISION = {
    "full": np.eye(3),
    "protanopia": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deuteranopia": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
    "tritanopia": np.array(
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ]
    ),
}
RGB_TO_XYZ = np.array(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)
WHITE = RGB_TO_XYZ.sum(1)
# In CIELAB units, of which 2.3 are just seen: the least pair, NT and 3-MGVT, has 14.
TOLD_APART = 12


def seen(colour: str, vision: np.ndarray) -> np.ndarray:
    """CIELAB coordinates of a colour as an eye of that vision sees it."""
    rgb = np.array(to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    xyz = RGB_TO_XYZ @ np.clip(vision @ linear, 0, 1) / WHITE
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def some(label: str, seed: int = 0) -> Curve:
    values = np.random.default_rng(seed).random((5, len(ITERATIONS))) * 0.5
    return curve(label, label, ITERATIONS, values)


@pytest.fixture
def figure() -> Figure:
    panels = {
        "learning": [some("NT"), some("GVT", 1)],
        "greedy": [some("NT", 2), some("GVT", 3)],
    }
    with look():
        return learning_figure(panels, optimum=0.83, limits=(-0.02, 0.9), title="3 rooms")


@pytest.mark.parametrize("vision", VISION)
def test_any_two_algorithms_are_told_apart(vision):
    # the known distance of two primaries keeps the conversion honest
    assert np.linalg.norm(seen("red", np.eye(3)) - seen("lime", np.eye(3))) == pytest.approx(
        170.6, abs=0.5
    )
    for a, b in itertools.combinations(COLOURS.values(), 2):
        distance = np.linalg.norm(seen(a, VISION[vision]) - seen(b, VISION[vision]))
        assert distance > TOLD_APART, (a, b)


def test_curves_are_told_apart_without_any_colour():
    styles = [STYLES.get(algorithm, "-") for algorithm in COLOURS]
    assert len(set(styles)) == len(styles)
    assert set(STYLES) <= set(COLOURS)


@pytest.mark.parametrize("vision", VISION)
def test_every_curve_is_seen_on_white(vision):
    for colour in (*COLOURS.values(), OPTIMUM):
        apart = np.linalg.norm(seen(colour, VISION[vision]) - seen("white", VISION[vision]))
        assert apart > 30, colour


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_label_of_an_experiment_belongs_to_an_algorithm_with_a_colour(name):
    for label in EXPERIMENTS[name].algorithms:
        if label in VARIANTS:  # of one algorithm, told apart from it and from all others
            assert VARIANTS[label] not in COLOURS.values()
            continue
        algorithm = re.match(r"(\d-)?[A-Z]+", label).group()
        assert some(algorithm).colour == COLOURS[algorithm]


def test_an_algorithm_without_a_colour():
    with pytest.raises(KeyError, match="SARSA"):
        some("SARSA")


def test_a_figure_says_what_its_axes_are(figure):
    learning, greedy = figure.axes
    assert (learning.get_title(loc="left"), greedy.get_title(loc="left")) == ("learning", "greedy")
    for ax in figure.axes:
        assert ax.get_xlabel() == "thousand iterations"
        assert ax.xaxis.get_major_formatter()(2500, 0) == "2.5"
    assert learning.get_ylabel() == "discounted return"
    assert learning.get_ylim() == greedy.get_ylim()
    assert learning.get_xlim() == (0, ITERATIONS[-1])
    assert figure.get_suptitle() == "3 rooms"


def test_a_figure_draws_the_mean_and_its_band(figure):
    for ax, seed in zip(figure.axes, (0, 2), strict=True):
        drawn, band = some("NT", seed), mean_interval(some("NT", seed).returns)
        line = next(x for x in ax.get_lines() if x.get_label() == "NT")
        np.testing.assert_allclose(line.get_xydata(), np.stack([ITERATIONS, band.centre], 1))
        assert to_hex(line.get_color()) == drawn.colour.lower()
        shade = next(x for x in ax.collections if isinstance(x, PolyCollection))
        assert to_hex(shade.get_facecolor()[0]) == drawn.colour.lower()
        assert 0 < shade.get_facecolor()[0, 3] < 0.5
        corners = shade.get_paths()[0].vertices
        for end in (band.low, band.high):
            for corner in np.stack([ITERATIONS, end], 1):
                assert np.abs(corners - corner).max(1).min() < 1e-9


def test_a_figure_draws_the_optimum_dashed(figure):
    for ax in figure.axes:
        (line,) = [x for x in ax.get_lines() if x.get_label() == "planned optimum"]
        assert line.get_linestyle() == "--"
        assert set(line.get_ydata()) == {0.83}
        assert ax.get_ylim()[0] < 0 < 0.83 < ax.get_ylim()[1]


def test_a_figure_has_one_legend_that_names_every_curve_once(figure):
    (legend,) = figure.legends
    assert [x.get_text() for x in legend.get_texts()] == ["NT", "GVT", "planned optimum"]
    assert all(ax.get_legend() is None for ax in figure.axes)


def test_without_an_optimum_none_is_drawn():
    ax = Figure().subplots()
    draw_curves(ax, [some("GVT")])
    assert [x.get_label() for x in ax.get_lines()] == ["GVT"]


def test_one_panel_is_enough():
    assert len(learning_figure({"learning": [some("NT")]}, 0.8, (0.0, 1.0)).axes) == 1


def test_one_run_has_no_band_and_is_refused():
    with pytest.raises(ValueError, match="at least 2 runs"):
        learning_figure(
            {"learning": [curve("NT", "NT", ITERATIONS, np.zeros((1, 10)))]}, 0.8, (0.0, 1.0)
        )


def test_the_look_ends_with_its_context():
    before = dict(mpl.rcParams)
    with look():
        assert mpl.rcParams["axes.grid"]
        assert dict(mpl.rcParams) != before
    assert dict(mpl.rcParams) == before


def test_a_small_png_is_a_small_png(figure):
    data = small_png(figure)
    with Image.open(io.BytesIO(data)) as picture:
        picture.verify()
        assert picture.format == "PNG"
        assert picture.mode == "P"
        width, height = picture.size
    assert width > height > 300
    # 45 settings of the sliders stay far below a page of 4 MB, also as base64
    assert len(data) < 50_000


def test_the_same_figure_gives_the_same_png(figure):
    assert small_png(figure) == small_png(figure)


class Images(HTMLParser):
    """The attributes of every element of a piece of HTML."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.mark.parametrize(
    "alt",
    [
        "λ = 10^-6, ψ = 0.5",
        'a "quoted" word',
        "x < y & y > z",
        "&quot;&lt;",
        '"><script>alert(1)</script>',
        "it's",
        "",
    ],
)
def test_an_image_carries_its_picture_and_its_description_whatever_it_says(alt):
    png = b"\x89PNG\x00\xff"
    parsed = Images(image_html(png, alt))
    ((tag, attributes),) = parsed.elements
    assert tag == "img"
    assert set(attributes) == {"alt", "src", "style"}
    assert attributes["alt"] == alt
    kind, _, data = attributes["src"].partition(",")
    assert kind == "data:image/png;base64"
    assert b64decode(data, validate=True) == png
    assert parsed.text == ""
