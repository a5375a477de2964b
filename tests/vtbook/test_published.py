"""The published curves: every file reads, and curves are looked up as steps."""

from __future__ import annotations

import numpy as np
import pytest

from vtbook import published
from vtbook.published import PublishedCurve, curves, rows

FIGURES = sorted(x.stem.removesuffix("-greedy") for x in published.FOLDER.glob("*-greedy.csv"))
CURVE = PublishedCurve(
    np.array([100, 200, 400]), *np.array([[1.0, 3.0, 8.0], [0.0, 2.0, 2.0], [2.0, 5.0, 9.0]])
)


def test_a_curve_holds_its_value_until_the_next():
    assert CURVE.at(100) == CURVE.at(199) == (1, 0, 2)
    assert CURVE.at(399) == (3, 2, 5)
    assert CURVE.at(10**6) == (8, 2, 9)
    with pytest.raises(ValueError, match="the published curve begins at 100, not at 99"):
        CURVE.at(99)


def test_until_is_the_mean_of_what_was_published_by_then():
    assert CURVE.until(100) == (1, 0, 2)
    assert CURVE.until(399) == (2, 1, 3.5)
    assert CURVE.until(400) == pytest.approx((4, 4 / 3, 16 / 3))


@pytest.mark.parametrize("figure", FIGURES)
@pytest.mark.parametrize("kind", ["learning", "greedy"])
def test_every_figure_has_the_curves_of_its_algorithms(figure, kind):
    found = curves(figure, kind)
    expected = {"GVT", "1-MGVT", "3-MGVT", "NT" if figure.startswith("rooms") else "DDQN"}
    # three of the mazes' figures have one mixture
    assert set(found) == expected - ({"3-MGVT"} if figure[-1].isdigit() else set())
    for one in found.values():
        assert (np.diff(one.iterations) > 0).all()
        assert all(len(x) == len(one.iterations) > 50 for x in one)
        # read off a drawing: the band's ends may lie a hair inside the line
        width = np.ptp([one.low, one.high])
        assert (one.low <= one.mean + 0.01 * width).all()
        assert (one.mean <= one.high + 0.01 * width).all()


def test_tables_have_columns_by_their_names():
    table = rows("rooms-likelihood")
    assert set(table["algorithm"]) == {"GVT", "1-MGVT"}
    assert set(table["iteration"]) == {500, 1_000, 4_000}
    for t in (1_000, 1_950):
        table = rows(f"rooms-number-of-sources-{t}")
        assert set(table["algorithm"]) == {"GVT", "1-MGVT", "2-MGVT"}
        for label in set(table["algorithm"]):
            assert sorted(table["sources"][table["algorithm"] == label]) == list(range(2, 11))
