"""One look: figures that carry what a reader needs."""

import itertools
import re
from base64 import b64decode, b64encode
from html import unescape
from io import BytesIO

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex
from PIL import Image
from xarray import Dataset

from vtbook import plots
from vtbook.plots import COLOURS
from vtbook.published import PublishedCurve
from vtlib.stats import mean_interval


def runs(seed):
    """Made-up returns of five runs at 100, 200, ... iterations, whose optimum is 0.75."""
    rng, dims = np.random.default_rng(seed), ("run", "iteration")
    kinds = {kind: (dims, rng.random((5, 10)) / 2) for kind in ("learning", "greedy")}
    return Dataset(kinds | {"optimum": ("run", [0.75] * 5)}, {"iteration": 100 * np.arange(1, 11)})


def shades(ax):
    return [x for x in ax.collections if isinstance(x, PolyCollection)]


def spans(shade, at, low, high):
    """Whether a shade reaches from one curve to another."""
    corners = shade.get_paths()[0].vertices
    wanted = np.concatenate([np.stack([at, end], 1) for end in (low, high)])
    return np.abs(corners - wanted[:, None]).max(2).min(1).max() < 1e-9


def test_a_figure_draws_each_kind_of_return_with_its_band_and_the_optimum_dashed(monkeypatch):
    stored = runs(0)
    figure = plots.returns_figure({"NT": stored, "GVT": runs(1)}, (-0.02, 0.9))
    at = stored.iteration.values
    for ax, kind in zip(figure.axes, plots.KINDS.values(), strict=True):
        band = mean_interval(stored[kind].values)
        line, _, dashed, _, _, ends, _ = ax.get_lines()
        np.testing.assert_allclose(line.get_data(), [at, band.centre])
        assert spans(shades(ax)[0], at, band.low, band.high)
        assert (dashed.get_linestyle(), set(dashed.get_ydata())) == ("--", {0.75})
        np.testing.assert_array_equal(ends.get_ydata(), stored[kind].values[:, -1])
        assert to_hex(line.get_color()) == to_hex(ends.get_color()) == COLOURS["NT"]
        assert ax.get_ylim() == (-0.02, 0.9)
    (legend,) = figure.legends
    assert {x.get_text() for x in legend.get_texts()} > {"NT", "GVT"}
    plots.small_png(figure)
    legend.get_texts()[0].set_text("a name as long as the figure is wide " * 3)
    with pytest.raises(ValueError, match="cut off"):
        plots.small_png(figure)
    monkeypatch.delenv(plots.CHECKED)  # as where a reader draws
    plots.small_png(figure)


def published(seed):
    """A made-up curve at 50, 150, ... iterations, which are not those of the runs."""
    mean = np.random.default_rng(seed).random(7) / 2
    return PublishedCurve(100 * np.arange(7) + 50, mean, mean - 0.1, mean + 0.2)


def test_runs_are_drawn_over_the_published_curves():
    shown = {"NT": runs(0), "GVT": runs(1), "fine-tuned": runs(2)}
    curves = {
        kind: {"GVT": published(i), "NT": published(i + 2), "3-MGVT": published(9)}
        for i, kind in enumerate(("learning", "greedy"))
    }
    # two of five runs come to nine tenths of their optimum, counted from a floor of -1
    shown["GVT"].learning[:2, 4] = -1 + 0.9 * 1.75 + 1e-9
    axes = plots.over_published(shown, curves, (-0.02, 0.9), floor=-1.0).axes
    assert [ax.get_title(loc="left") for ax in axes[:2]] == ["NT", "GVT"]
    for ax, (kind, label) in zip(axes, itertools.product(curves, ("NT", "GVT")), strict=True):
        stored, theirs = shown[label], curves[kind][label]
        *single, dashed, mean, _ = ax.get_lines()
        alone = stored.learning.values.tolist() if kind == "learning" else []
        assert [x.get_ydata().tolist() for x in single] == alone
        np.testing.assert_array_equal(dashed.get_data(), [theirs.iterations, theirs.mean])
        np.testing.assert_allclose(mean.get_ydata(), stored[kind].values.mean(0))
        assert spans(shades(ax)[0], theirs.iterations, theirs.low, theirs.high)
        solved = f"{2 if label == 'GVT' else 0} of 5 solved" if kind == "learning" else ""
        assert ax.get_title(loc="right") == solved


def test_an_image_carries_its_picture_and_its_description_whatever_it_says():
    png, alt = b"\x89PNG\x00\xff", '"><script>x</script> &quot; a "word": x < y & y > z'
    html = plots.image_html(png, alt)
    told, source = re.fullmatch(r'<img alt="([^"<]*)" style="[^"]*" src="([^"]*)">', html).groups()
    assert unescape(told) == alt
    assert source == f"data:image/png;base64,{b64encode(png).decode()}"


def test_a_figure_of_panels_has_a_picture_for_telephones_beside_its_own():
    with plots.look():
        figure = plots.BookFigure(figsize=(7.6, 3))
        drawing = plots.BookFigure(figsize=(3, 3), layout="none")
        figure.subplots(1, 2), drawing.add_axes((0.2, 0.2, 0.7, 0.7))
        wide, tall = plots.figure_html(figure, "two"), plots.figure_html(drawing, "one")
    sizes = []
    for source in re.findall(r"base64,([^\"]*)", wide):
        sizes.append(Image.open(BytesIO(b64decode(source))).size)
    narrow, own = sizes  # the browser takes the first that fits
    assert narrow[0] < own[0]
    assert narrow[1] > own[1]
    assert wide.startswith('<picture><source media="(max-width: 600px)"')
    assert wide.count('alt="two"') == 1
    assert tall.startswith('<img alt="one"')
