"""The chart of a panel that trains: what does not move on it."""

import re

from vtbook.panel_chart import BOX, axes, stored

LIMITS = (-1.0, 1.0)


def test_ticks_stand_at_their_values_and_the_iterations_end_at_the_right():
    svg = axes(LIMITS, (-1.0, 0.0, 1.0), 5_000)
    left, right, top, bottom = BOX
    heights = [float(y) for y in re.findall(r'y1="([\d.]+)"', svg)]
    assert heights == [bottom, (top + bottom) / 2, top]
    assert re.findall(r">([^<]+)</text>", svg)[:3] == ["−1", "0", "1"]
    assert svg.endswith(f'<text x="{right:.1f}" y="{bottom + 15}" text-anchor="end">5,000</text>')
    assert f'x1="{left}"' in svg


def test_a_stored_curve_is_held_to_the_chart():
    curve = {"family": "GVT", "colour": "#123456", "iterations": [0, 100], "values": [0.0, 9.0]}
    svg = stored([curve], LIMITS, 100)
    assert 'class="GVT" style="--own: #123456"' in svg
    assert 'points="34.0,111.0 372.0,22.0"' in svg
