"""The published curves: they are looked up as steps."""

import numpy as np
import pytest

from vtbook.published import PublishedCurve


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
