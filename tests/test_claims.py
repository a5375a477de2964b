"""Each claim on returns made so that its verdict is known."""

from __future__ import annotations

from collections.abc import Sequence
from html.parser import HTMLParser

import numpy as np
import pytest

from vtlib.claims import (
    NOT,
    PARTLY,
    REPRODUCED,
    Claim,
    Returns,
    better_and_steadier,
    falls_with,
    no_better,
    only_beginning,
    optimal_by,
    solves_most,
    table,
    verdict,
    worse_and_wider,
)

ITERATIONS = np.array([1000, 2000, 3000])
# Deviations of eight runs that leave the mean alone.
WAVE = np.array([1, -1, 1, -1, 1, -1, 1, -1])


def returns(
    means: Sequence[float],
    spread: float = 0.01,
    greedy: np.ndarray | None = None,
    optimum: float = 0.8,
) -> Returns:
    """Eight runs whose learning returns have these means at three iterations."""
    learning = np.asarray(means) + spread * WAVE[:, None]
    return Returns(
        ITERATIONS,
        learning.astype(np.float32),
        learning if greedy is None else greedy,
        np.full(len(WAVE), optimum),
    )


def greedy_solving(shares: Sequence[float]) -> np.ndarray:
    """Greedy returns (8, 3) that solve these shares of the tasks at three iterations."""
    run = np.arange(len(WAVE))[:, None]
    return np.where(run < np.round(np.asarray(shares) * len(WAVE)), 0.75, 0.1)


def test_returns_are_looked_up_by_iteration():
    runs = returns([0.1, 0.2, 0.3], spread=0, greedy=greedy_solving([0, 0.5, 1]))
    np.testing.assert_allclose(runs.at(2000), 0.2, rtol=1e-6)
    np.testing.assert_array_equal(runs.at(3000, "greedy"), 0.75)
    assert [runs.solved(t) for t in ITERATIONS] == [0.0, 0.5, 1.0]


@pytest.mark.parametrize("iteration", [0, 1500, 4000, -1])
def test_an_iteration_that_was_not_recorded(iteration):
    runs = returns([0.1, 0.2, 0.3])
    with pytest.raises(ValueError, match=f"iteration {iteration} was not recorded"):
        runs.at(iteration)
    with pytest.raises(ValueError, match="not recorded"):
        optimal_by("MGVT", runs, iteration)


def test_a_run_is_solved_against_its_own_optimum():
    greedy = np.full((2, 3), 0.72)
    runs = Returns(ITERATIONS, greedy, greedy, np.array([0.79, 0.81]))
    assert runs.solved(1000) == 0.5


@pytest.mark.parametrize(
    ("passed", "expected"),
    [
        ([True, True], REPRODUCED),
        ([True, False], PARTLY),
        ([False, True], PARTLY),
        ([False, False], NOT),
    ],
)
def test_the_verdict_of_parts(passed, expected):
    assert verdict(passed) == expected


@pytest.mark.parametrize(
    ("means", "expected", "number"),
    [
        ([0.5, 0.776, 0.788], REPRODUCED, "first at 2,000"),
        ([0.776, 0.788, 0.788], REPRODUCED, "first at 1,000"),
        ([0.2, 0.5, 0.776], PARTLY, "first at 3,000"),
        ([0.2, 0.776, 0.5], PARTLY, "at the end 62.5%"),
        ([0.2, 0.4, 0.6], NOT, "reached never"),
    ],
)
def test_optimal_by(means, expected, number):
    claim = optimal_by("1-MGVT", returns(means), 2000)
    assert claim.verdict == expected
    assert number in claim.evidence
    assert "1-MGVT" in claim.text
    assert "2,000" in claim.text
    assert f"Learning return at 2,000: {means[1] / 0.8:.1%} of the optimum" in claim.evidence


@pytest.mark.parametrize(
    ("shares", "expected"),
    [
        ([0.0, 0.75, 1.0], REPRODUCED),
        ([0.0, 0.5, 1.0], PARTLY),
        ([0.0, 0.75, 0.25], PARTLY),
        ([0.0, 0.25, 0.5], NOT),
    ],
)
def test_solves_most(shares, expected):
    runs = returns([0.1, 0.1, 0.1], greedy=greedy_solving(shares))
    claim = solves_most("GVT", runs, 2000)
    assert claim.verdict == expected
    assert f"in {shares[1]:.0%} of the runs at 2,000 iterations" in claim.evidence
    assert f"in {shares[2]:.0%} at the end" in claim.evidence
    assert "within 10% of the optimum" in claim.evidence


@pytest.mark.parametrize(
    ("value", "expected"), [(0.05, REPRODUCED), (0.39, REPRODUCED), (0.0, PARTLY)]
)
def test_only_beginning(value, expected):
    claim = only_beginning("NT", returns([0.0, value, 0.8]), 2000)
    assert claim.verdict == expected
    assert f"Learning return at 2,000: {value:.3f} (95% interval" in claim.evidence
    assert f"that is {value / 0.8:.0%} of the optimum" in claim.evidence


def test_only_beginning_is_not_reproduced_by_an_optimal_return():
    assert only_beginning("NT", returns([0.0, 0.8, 0.8]), 2000).verdict == NOT


@pytest.mark.parametrize(
    ("mean", "spread", "expected"),
    [(0.7, 0.01, REPRODUCED), (0.7, 0.1, PARTLY), (0.5, 0.01, PARTLY), (0.5, 0.1, NOT)],
)
def test_better_and_steadier(mean, spread, expected):
    a, b = returns([0, mean, 0], spread), returns([0, 0.6, 0], 0.05)
    claim = better_and_steadier("MGVT", a, "GVT", b, 2000)
    assert claim.verdict == expected
    assert f"MGVT minus GVT: {mean - 0.6:.3f} (95% interval" in claim.evidence
    deviation = np.std(spread * WAVE, ddof=1)
    assert f"{deviation:.3f} against {np.std(0.05 * WAVE, ddof=1):.3f}" in claim.evidence


@pytest.mark.parametrize(
    ("during", "end", "expected"),
    [(0.6, 0.6, REPRODUCED), (0.5, 0.5, REPRODUCED), (0.7, 0.6, PARTLY), (0.7, 0.7, NOT)],
)
def test_no_better(during, end, expected):
    a = returns([during, end, during], 0.02)
    claim = no_better("3-MGVT", a, "1-MGVT", returns([0.6, 0.6, 0.6], 0.01), 2000)
    assert claim.verdict == expected
    assert f"{end - 0.6:.3f}" in claim.evidence
    assert "at 2,000 iterations" in claim.evidence


def test_no_better_counts_a_difference_only_where_its_interval_excludes_zero():
    a, b = returns([0.62] * 3, spread=0.1), returns([0.6] * 3, spread=0.0)
    assert no_better("3-MGVT", a, "1-MGVT", b, 3000).verdict == REPRODUCED


class Cells(HTMLParser):
    """Text of the cells of a table, and the classes it uses."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.cells: list[str] = []
        self.classes: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.classes += [value or "" for name, value in attrs if name == "class"]
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_data(self, data: str) -> None:
        if self.cells:
            self.cells[-1] += data


def test_the_table_shows_every_claim_with_its_verdict_and_numbers():
    claims = [Claim(f"text {v}", v, f"numbers {v}") for v in (REPRODUCED, PARTLY, NOT)]
    shown = Cells(table(claims))
    expected = [x for c in claims for x in (c.text, c.verdict, c.evidence)]
    assert shown.cells == ["Claim", "Verdict", "Numbers", *expected]
    assert shown.classes == [
        "claims",
        "verdict reproduced",
        "verdict partly",
        "verdict not",
    ]


def test_the_table_escapes_what_it_shows():
    hostile = "<script>alert('&lt;\"')</script> & <b>"
    html = table([Claim(hostile, PARTLY, hostile)])
    assert "<script" not in html
    assert "<b>" not in html
    shown = Cells(html)
    assert shown.cells[3] == shown.cells[5] == hostile
    assert set(shown.tags) == {"table", "thead", "tbody", "tr", "th", "td"}


@pytest.mark.parametrize(
    ("mean", "spread", "expected"),
    [(0.4, 0.2, REPRODUCED), (0.4, 0.001, PARTLY), (0.8, 0.2, PARTLY), (0.8, 0.001, NOT)],
)
def test_worse_and_wider(mean, spread, expected):
    other = returns([0.1, 0.4, 0.75])
    claim = worse_and_wider("GVT", returns([0.1, 0.2, mean], spread), "1-MGVT", other, 3000)
    assert claim.verdict == expected


@pytest.mark.parametrize(("slope", "expected"), [(-0.1, REPRODUCED), (0.1, NOT)])
def test_falls_with(slope, expected):
    distance = np.linspace(0, 4, len(WAVE))
    runs = returns([0.1, 0.2, 0.4])
    runs.learning[:, -1] = 0.4 + slope * distance + 0.001 * WAVE
    assert falls_with("GVT", runs, distance, 3000).verdict == expected


def test_a_slope_that_may_be_chance_is_not_reproduced():
    distance = np.linspace(0, 4, len(WAVE))
    runs = returns([0.1, 0.2, 0.4])
    noise = np.array([1.0, -1.0] * (len(WAVE) // 2))
    runs.learning[:, -1] = 0.4 - 0.001 * distance + 0.1 * noise
    assert falls_with("GVT", runs, distance, 3000).verdict == NOT
