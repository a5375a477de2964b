"""The chart of a panel that trains: its axes, and the stored curves, which do not move."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

BOX = 34, 372, 22, 200  # left, right, top and bottom, in the picture's units


def axes(limits: tuple[float, float], ticks: Sequence[float], iterations: int) -> str:
    """SVG of lines at the ticks of the return, with their names and those of the iterations."""
    left, right, _, bottom = BOX
    parts = []
    for tick in ticks:
        y = _down(tick, limits)
        parts.append(f'<line x1="{left}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}"/>')
        name = f"{tick:g}".replace("-", "−")
        parts.append(f'<text x="{left - 6}" y="{y + 4:.1f}" text-anchor="end">{name}</text>')
    for at in range(0, iterations + 1, iterations // 5):
        anchor = "end" if at == iterations else "middle"
        x = _across(at, iterations)
        text = f'<text x="{x:.1f}" y="{bottom + 15}" text-anchor="{anchor}">{at:,}</text>'
        parts.append(text)
    return "".join(parts)


def stored(
    references: Sequence[Mapping[str, Any]], limits: tuple[float, float], iterations: int
) -> str:
    """SVG of stored curves, each of a family and in its colour."""
    return "".join(
        f'<polyline class="{one["family"]}" style="--own: {one["colour"]}" '
        f'points="{_points(one, limits, iterations)}"/>'
        for one in references
    )


def _points(one: Mapping[str, Any], limits: tuple[float, float], iterations: int) -> str:
    pairs = zip(one["iterations"], one["values"], strict=True)
    return " ".join(f"{_across(t, iterations):.1f},{_down(y, limits):.1f}" for t, y in pairs)


def _across(iteration: float, iterations: int) -> float:
    left, right, *_ = BOX
    return left + (right - left) * iteration / iterations


def _down(value: float, limits: tuple[float, float]) -> float:
    *_, top, bottom = BOX
    least, most = limits
    return bottom - (bottom - top) * (float(np.clip(value, least, most)) - least) / (most - least)
