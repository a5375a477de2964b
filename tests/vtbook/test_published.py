"""The published curves: every file reads, and curves are looked up as steps."""

from itertools import product

import numpy as np
import pytest

from vtbook import published
from vtbook.published import PublishedCurve, curves, rows

FIGURES = sorted(x.stem.removesuffix("-greedy") for x in published.FOLDER.glob("*-greedy.csv"))


def test_a_curve_holds_its_value_until_the_next_and_has_means():
    bands = np.array([[1.0, 3.0, 8.0], [0.0, 2.0, 2.0], [2.0, 5.0, 9.0]])
    curve = PublishedCurve(np.array([100, 200, 400]), *bands)
    assert curve.at(100) == curve.at(199) == curve.until(100) == (1, 0, 2)
    assert curve.at(399) == (3, 2, 5)
    assert curve.at(10**6) == (8, 2, 9)
    assert curve.until(399) == (2, 1, 3.5)
    assert curve.until(400) == pytest.approx((4, 4 / 3, 16 / 3))
    with pytest.raises(ValueError, match="the published curve begins at 100, not at 99"):
        curve.at(99)


@pytest.mark.parametrize("figure", FIGURES)
@pytest.mark.parametrize("kind", ["learning", "greedy"])
def test_every_figure_has_the_curves_of_its_algorithms(figure, kind):
    found = curves(figure, kind)
    expected = {"GVT", "1-MGVT", "3-MGVT", "NT" if figure.startswith("rooms") else "DDQN"}
    one_mixture = figure in ("maze-0", "maze-6", "maze-13")
    assert set(found) == expected - ({"3-MGVT"} if one_mixture else set())
    for one in found.values():
        assert (np.diff(one.iterations) > 0).all()
        assert all(len(x) == len(one.iterations) > 50 for x in one)
        # read off a drawing: the band's ends may lie a hair inside the line
        width = np.ptp([one.low, one.high])
        assert (np.diff([one.low, one.mean, one.high], axis=0) >= -0.01 * width).all()


@pytest.mark.parametrize("t", [1_000, 1_950])
def test_each_number_of_sources_has_a_row_for_each_algorithm(t):
    table = rows(f"rooms-number-of-sources-{t}")[["algorithm", "sources"]]
    assert sorted(table.tolist()) == list(product(("1-MGVT", "2-MGVT", "GVT"), range(2, 11)))
