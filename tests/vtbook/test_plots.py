"""One look: colours told apart by every eye, and figures that carry what a reader needs."""

import itertools

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex, to_rgb
from xarray import Dataset

from vtbook import plots
from vtbook.plots import COLOURS, STYLES
from vtbook.published import PublishedCurve
from vtlab.stats import mean_interval

# Full dichromacy, acting on linear RGB: Machado, Oliveira and Fernandes (2009), table 1.
VISION = {
    "full": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "protanopia": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "deuteranopia": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "tritanopia": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
# What book.css makes of figures in the dark theme: invert(0.9), and hues turned by half a circle.
HALF_TURN = 2 * np.array([0.213, 0.715, 0.072]) - np.eye(3)


def linear(colour):
    rgb = np.array(to_rgb(colour))
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def contrast(a, b):
    """How much lighter one of two colours is than the other, after WCAG."""
    darker, lighter = sorted(0.05 + TO_XYZ[1] @ linear(x) for x in (a, b))
    return lighter / darker


def in_the_dark(colour):
    return tuple(np.clip(HALF_TURN @ (0.9 - 0.8 * np.array(to_rgb(colour))), 0, 1))


def seen(colour, vision):
    """CIELAB coordinates of a colour as an eye of that vision sees it."""
    xyz = TO_XYZ @ np.clip(np.array(VISION[vision]) @ linear(colour), 0, 1) / TO_XYZ.sum(1)
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("vision", VISION)
def test_any_two_algorithms_are_told_apart_by_every_eye_on_light_and_dark_pages(vision):
    for a, b in itertools.combinations(COLOURS.values(), 2):  # of CIELAB's units 2.3 are just seen
        assert np.linalg.norm(seen(a, vision) - seen(b, vision)) > 12, (a, b)
        dark = [seen(in_the_dark(x), vision) for x in (a, b)]
        assert np.linalg.norm(dark[0] - dark[1]) > 5, (a, b)


def runs(seed):
    """Made-up returns of five runs at 100, 200, ... iterations, whose optimum is 0.75."""
    rng, dims = np.random.default_rng(seed), ("run", "iteration")
    kinds = {kind: (dims, rng.random((5, 10)) / 2) for kind in ("learning", "greedy")}
    return Dataset(kinds | {"optimum": ("run", [0.75] * 5)}, {"iteration": 100 * np.arange(1, 11)})


def test_every_algorithm_has_its_own_line_and_is_seen_on_light_and_dark_pages():
    assert len({STYLES.get(algorithm, "-") for algorithm in COLOURS}) == len(COLOURS)
    for label, colour in COLOURS.items():
        assert contrast(colour, "white") > 3, label
        assert contrast(in_the_dark(colour), in_the_dark("white")) > 3.9, label


def shades(ax):
    return [x for x in ax.collections if isinstance(x, PolyCollection)]


def spans(shade, at, low, high):
    """Whether a shade reaches from one curve to another."""
    corners = shade.get_paths()[0].vertices
    wanted = np.concatenate([np.stack([at, end], 1) for end in (low, high)])
    return np.abs(corners - wanted[:, None]).max(2).min(1).max() < 1e-9


def test_a_figure_draws_each_kind_of_return_with_its_band_and_a_solid_optimum(monkeypatch):
    stored = runs(0)
    figure = plots.returns_figure({"NT": stored, "GVT": runs(1)}, (-0.02, 0.9))
    at = stored.iteration.values
    for ax, kind in zip(figure.axes, plots.KINDS.values(), strict=True):
        band = mean_interval(stored[kind].values)
        line, _, optimum, _, _, ends, _ = ax.get_lines()
        np.testing.assert_allclose(line.get_data(), [at, band.centre])
        assert spans(shades(ax)[0], at, band.low, band.high)
        assert (optimum.get_linestyle(), set(optimum.get_ydata())) == ("-", {0.75})
        np.testing.assert_array_equal(ends.get_ydata(), stored[kind].values[:, -1])
        assert to_hex(line.get_color()) == to_hex(ends.get_color()) == COLOURS["NT"]
        assert ax.get_ylim() == (-0.02, 0.9)
    (legend,) = figure.legends
    assert {x.get_text() for x in legend.get_texts()} > {"NT", "GVT"}
    plots.small_picture(figure)
    legend.get_texts()[0].set_text("a name as long as the figure is wide " * 3)
    with pytest.raises(ValueError, match="cut off"):
        plots.small_picture(figure)
    monkeypatch.delenv(plots.CHECKED)  # as where a reader draws
    plots.small_picture(figure)


def published(seed):
    """A made-up curve at 50, 150, ... iterations, which are not those of the runs."""
    mean = np.random.default_rng(seed).random(7) / 2
    return PublishedCurve(100 * np.arange(7) + 50, mean, mean - 0.1, mean + 0.2)


def test_shares_of_the_optimum_have_their_names_on_the_curves():
    ax, own = plots.BookFigure().subplots(), {"1-MGVT": runs(0), "NT": runs(1)}
    plots.draw_shares(ax, own, {"1-MGVT": (100, 0.5), "NT": (200, 0.1)}, "early")
    for line, stored in zip(ax.lines, own.values(), strict=True):
        np.testing.assert_allclose(line.get_ydata(), stored.learning.mean("run") / 0.75)
    named = {text.get_text(): to_hex(text.get_color()) for text in ax.texts}
    assert named == {"1-MGVT": COLOURS["1-MGVT"].lower(), "no transfer": COLOURS["NT"].lower()}


def test_runs_are_drawn_over_the_published_curves():
    shown = {"NT": runs(0), "GVT": runs(1), "fine-tuned": runs(2)}
    curves = {
        kind: {"GVT": published(i), "NT": published(i + 2), "3-MGVT": published(9)}
        for i, kind in enumerate(("learning", "greedy"))
    }
    axes = plots.over_published(shown, curves, (-0.02, 0.9)).axes
    assert [ax.get_title(loc="left") for ax in axes[:2]] == ["NT", "GVT"]
    greedy = plots.over_published(shown, curves, (0, 1), {"greedy return": "greedy"})
    assert len(greedy.axes) == 2
    for ax, (kind, label) in zip(axes, itertools.product(curves, ("NT", "GVT")), strict=True):
        stored, theirs = shown[label], curves[kind][label]
        *single, dashed, mean, _ = ax.get_lines()
        alone = stored.learning.values.tolist() if kind == "learning" else []
        assert [x.get_ydata().tolist() for x in single] == alone
        np.testing.assert_array_equal(dashed.get_data(), [theirs.iterations, theirs.mean])
        np.testing.assert_allclose(mean.get_ydata(), stored[kind].values.mean(0))
        assert spans(shades(ax)[0], theirs.iterations, theirs.low, theirs.high)
