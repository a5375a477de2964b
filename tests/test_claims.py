"""Each claim on returns made so that its verdict is known."""

from __future__ import annotations

from collections.abc import Sequence
from html.parser import HTMLParser

import numpy as np
import pytest

from vtlib import visits
from vtlib.claims import (
    NOT,
    PARTLY,
    REPRODUCED,
    Claim,
    Returns,
    arrives,
    better_and_steadier,
    covers_more,
    earns_half,
    ends_at_optimum,
    falls_behind_on_unlikely,
    falls_with,
    gap_closes,
    gathers_at_door,
    in_task,
    learns_faster,
    little_jump_start,
    moves_early,
    never_arrives,
    no_advantage,
    no_better,
    not_by,
    only_beginning,
    optimal_by,
    optimal_for_all,
    optimal_only_with,
    solves_most,
    starts_near_optimum,
    table,
    transfers_negatively,
    verdict,
    worse_and_wider,
)
from vtlib.experiments.exploration import visited

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


def arrivals_of(reached: int, runs: int = 10) -> np.ndarray:
    """Arrivals of runs of which so many arrive, the first once, the second twice and so on."""
    return np.where(np.arange(runs) < reached, np.arange(1, runs + 1), 0)


@pytest.mark.parametrize(("reached", "expected"), [(0, REPRODUCED), (4, REPRODUCED), (5, NOT)])
def test_never_arrives_means_fewer_than_half_of_the_runs(reached, expected):
    claim = never_arrives("NT", arrivals_of(reached))
    assert claim.verdict == expected
    assert claim.text == "NT does not reach the goal."
    assert f"{reached} of 10 runs arrive at least once" in claim.evidence


@pytest.mark.parametrize(("reached", "expected"), [(10, REPRODUCED), (9, REPRODUCED), (8, NOT)])
def test_arrives_means_nine_runs_in_ten(reached, expected):
    claim = arrives("GVT", arrivals_of(reached))
    assert claim.verdict == expected
    assert claim.text == "GVT reaches the goal."
    assert f"{reached} of 10 runs arrive at least once" in claim.evidence


@pytest.mark.parametrize(
    ("arrivals", "median"), [([0, 0, 0, 7], "0"), ([0, 3, 4, 90], "3.5"), ([5, 5, 83], "5")]
)
def test_the_median_run_arrives_so_often(arrivals, median):
    for claim in (never_arrives("NT", np.array(arrivals)), arrives("NT", np.array(arrivals))):
        assert f"the median run arrives {median} times" in claim.evidence


@pytest.mark.parametrize(
    ("mean", "spread", "expected"),
    [(0.3, 0.01, REPRODUCED), (0.14, 0.1, NOT), (0.1, 0.01, NOT)],
    ids=["clearly more", "more by chance", "less"],
)
def test_gathers_at_door(mean, spread, expected):
    claim = gathers_at_door("GVT", mean + spread * WAVE, 0.126)
    assert claim.verdict == expected
    assert "GVT" in claim.text
    # Student's quantile of seven degrees of freedom
    half = 2.365 * np.std(spread * WAVE, ddof=1) / np.sqrt(len(WAVE))
    ends = f"{mean:.3f} (95% interval {mean - half:.3f} to {mean + half:.3f})"
    assert f"lie at the door: {ends}; spread evenly 0.126." in claim.evidence


@pytest.mark.parametrize(
    ("cells", "effective", "expected"),
    [
        (5.0, 2.0, REPRODUCED),
        (5.0, 0.0, PARTLY),
        (0.1, 2.0, PARTLY),
        (0.1, 0.1, NOT),
        (-5.0, -2.0, NOT),
    ],
)
def test_covers_more(cells, effective, expected):
    shared = np.linspace(10, 40, len(WAVE))
    pairs = {
        "cells": (shared + cells + WAVE, shared),
        "effective": (shared / 2 + effective + WAVE, shared / 2),
    }
    claim = covers_more("1-MGVT", "GVT", pairs)
    assert claim.verdict == expected
    assert claim.text == "1-MGVT covers the lower room more widely than GVT."
    half = 2.365 * np.std(WAVE, ddof=1) / np.sqrt(len(WAVE))
    for name, base, gain in (("cells", 25.0, cells), ("effective", 12.5, effective)):
        ends = f"{gain:.3f} (95% interval {gain - half:.3f} to {gain + half:.3f})"
        means = f"{name} {base + gain:.1f} against {base:.1f}"
        assert f"{means}, difference {ends}" in claim.evidence


# Densities of nine tasks, out of order; the three least likely are the last, third and sixth.
LIKELIHOOD = np.array([0.22, 0.12, 0.05, 0.20, 0.15, 0.08, 0.18, 0.10, 0.02])
UNLIKELY = np.array([2, 5, 8])


@pytest.mark.parametrize(
    ("level", "slope", "noise", "expected"),
    [
        (-0.4, 2.0, 0.0, REPRODUCED),
        (-0.2, 0.0, 0.01, PARTLY),
        (0.1, 2.0, 0.0, PARTLY),
        (0.0, 0.0, -0.1, NOT),
        (0.3, -2.0, 0.0, NOT),
    ],
    ids=["falls behind", "behind everywhere", "never behind", "by chance", "the other way round"],
)
def test_falls_behind_on_unlikely(level, slope, noise, expected):
    gap = level + slope * LIKELIHOOD + noise * np.array([1, -1, 1, 1, -1, -1, -1, 1, 0.5])
    b = np.linspace(0.5, 0.9, 9)
    claim = falls_behind_on_unlikely("GVT", b + gap, "1-MGVT", b, LIKELIHOOD, "At 500")
    assert claim.verdict == expected
    assert claim.text == "At 500 iterations GVT falls behind 1-MGVT on unlikely tasks."
    others = np.delete(gap, UNLIKELY).mean()
    assert claim.evidence.startswith("GVT minus 1-MGVT, as a share")
    assert f"optimum: {gap[UNLIKELY].mean():.3f} (95% interval" in claim.evidence
    assert f"on the 3 least likely tasks, {others:.3f} on the others" in claim.evidence
    fitted = np.polyfit(LIKELIHOOD, gap, 1)[0]
    assert f"slope over the density {fitted:.3f} (95% interval" in claim.evidence


@pytest.mark.parametrize(("tasks", "least"), [(9, 3), (20, 7), (3, 1)])
def test_a_third_of_the_tasks_is_unlikely(tasks, least):
    likelihood = np.linspace(0.01, 0.2, tasks)
    if least < 2:
        with pytest.raises(ValueError, match="at least 2"):
            falls_behind_on_unlikely("a", likelihood, "b", likelihood, likelihood, "")
        return
    claim = falls_behind_on_unlikely("a", likelihood, "b", likelihood, likelihood, "")
    assert f"on the {least} least likely tasks" in claim.evidence


@pytest.mark.parametrize(
    ("share", "expected", "reach"),
    [
        ([0.9, 0.95, 0.97, 0.98], REPRODUCED, "4 of 4"),
        ([0.6, 0.99, 1.0, 1.01], NOT, "3 of 4"),
        ([0.8, 0.99, 1.0, 1.01], PARTLY, "3 of 4"),
        ([0.3, 0.4, 0.5, 0.6], NOT, "0 of 4"),
    ],
    ids=["all", "one far off", "one off", "none"],
)
def test_optimal_for_all(share, expected, reach):
    claim = optimal_for_all("1-MGVT", np.array(share), "At 4,000")
    assert claim.verdict == expected
    assert "1-MGVT" in claim.text
    assert claim.evidence == (
        f"At 4,000 {reach} tasks reach 90% of their optimum; "
        f"the least earns {share[0]:.0%}, the mean {np.mean(share):.0%}."
    )


@pytest.mark.parametrize(
    ("early", "late", "expected"),
    [
        (0.5, 0.66, REPRODUCED),
        (0.0, 0.3, REPRODUCED),
        (0.5, 0.68, PARTLY),
        (0.9, 0.5, PARTLY),
        (0.9, 1.2, NOT),
    ],
)
def test_earns_half(early, late, expected):
    b = 0.5 + 0.1 * WAVE
    pairs = {"at 1,000": (0.5 * early * np.ones(8), b), "at 1,950": (late * b[::-1], b)}
    claim = earns_half("GVT", "2-MGVT", pairs)
    assert claim.verdict == expected
    assert claim.text == "With two sources GVT earns about half of what 2-MGVT does."
    assert claim.evidence == (
        f"GVT against 2-MGVT at 1,000 {0.5 * early:.2f} against 0.50; "
        f"at 1,950 {0.5 * late:.2f} against 0.50."
    )


@pytest.mark.parametrize(
    ("few", "many", "spread", "expected"),
    [
        (-0.3, 0.0, 0.01, REPRODUCED),
        (0.3, -0.1, 0.2, REPRODUCED),
        (-0.3, -0.1, 0.01, PARTLY),
        (-0.3, 0.1, 0.01, PARTLY),
        (0.01, -0.05, 0.2, PARTLY),
        (-0.1, -0.3, 0.01, NOT),
        (0.0, 0.3, 0.01, NOT),
        (0.0, -0.3, 0.01, NOT),
    ],
)
def test_gap_closes(few, many, spread, expected):
    b = np.linspace(0.4, 0.8, len(WAVE))
    ends = [(b + gap + spread * WAVE, b) for gap in (few, many)]
    claim = gap_closes("GVT", ends[0], "1-MGVT", ends[1], "At 1,950")
    assert claim.verdict == expected
    assert claim.text == "GVT and 1-MGVT meet as sources grow."
    half = 2.365 * np.std(spread * WAVE, ddof=1) / np.sqrt(len(WAVE))
    start, end = (
        f"{gap:.3f} (95% interval {gap - half:.3f} to {gap + half:.3f})" for gap in (few, many)
    )
    assert claim.evidence == (
        f"At 1,950 GVT minus 1-MGVT: {start} with the fewest sources, {end} with the most."
    )


def over_time(learning: Sequence[float], greedy: Sequence[float], optimum: float = 60.0) -> Returns:
    """Eight runs with these mean returns at 500, 1,000, ... iterations."""
    at = 500 * np.arange(1, len(learning) + 1)
    spread = 0.01 * WAVE[:, None]
    curves = (np.asarray(values) + spread for values in (learning, greedy))
    return Returns(at, *curves, np.full(len(WAVE), optimum))


@pytest.mark.parametrize(
    ("learning", "greedy", "expected"),
    [(55.0, 58.0, REPRODUCED), (50.0, 58.0, PARTLY), (55.0, 50.0, PARTLY), (20.0, 20.0, NOT)],
)
def test_starts_near_optimum(learning, greedy, expected):
    claim = starts_near_optimum("GVT", over_time([learning, 60], [greedy, 60]))
    assert claim.verdict == expected
    assert f"at 500 iterations: {greedy / 60:.0%}" in claim.evidence
    assert f"at 500: {learning / 60:.0%}" in claim.evidence


@pytest.mark.parametrize(("learning", "expected"), [(53.0, REPRODUCED), (55.0, NOT)])
def test_not_by(learning, expected):
    assert not_by("DDQN", over_time([10, learning], [0, 0]), 1_000).verdict == expected


@pytest.mark.parametrize(
    ("greedy", "expected"), [([10, 30, 50, 52, 50], REPRODUCED), ([10, 30, 50, 30, 50], NOT)]
)
def test_moves_early(greedy, expected):
    claim = moves_early("GVT", over_time([0] * 5, greedy), 1_500)
    assert claim.verdict == expected
    assert "20.00 until 1,500" in claim.evidence


@pytest.mark.parametrize(
    ("judge", "clear", "unclear"),
    [(learns_faster, REPRODUCED, NOT), (no_advantage, NOT, REPRODUCED)],
)
@pytest.mark.parametrize("gain", [1.0, 0.0, -1.0])
def test_learns_faster_and_its_opposite_no_advantage(judge, clear, unclear, gain):
    a, b = over_time([20 + gain, 30, 0], [0] * 3), over_time([20, 30, 60], [0] * 3)
    claim = judge("1-MGVT", a, "DDQN", b, 1_000)
    assert claim.verdict == (clear if gain > 0 else unclear)
    assert f"first 1,000 iterations: {gain / 2:.3f}" in claim.evidence


@pytest.mark.parametrize(("start", "expected"), [(-75.0, REPRODUCED), (-73.0, NOT)])
def test_little_jump_start(start, expected):
    a, b = (over_time([x, -50], [0] * 2, -50.0) for x in (start, -79.0))
    assert little_jump_start("1-MGVT", a, "DDQN", b).verdict == expected


@pytest.mark.parametrize(
    ("learning", "greedy", "expected"),
    [(-54, -50, REPRODUCED), (-56, -54, PARTLY), (-54, -56, PARTLY), (-56, -80, NOT)],
)
def test_ends_at_optimum(learning, greedy, expected):
    claim = ends_at_optimum("1-MGVT", over_time([-90, learning], [-90, greedy], -50.0))
    assert claim.verdict == expected
    assert f"learning return is {learning:.1f}" in claim.evidence


@pytest.mark.parametrize(
    ("learning", "greedy", "expected"),
    [(-0.1, -0.1, REPRODUCED), (-0.1, 0.0, PARTLY), (0.0, -0.1, PARTLY), (0.1, 0.1, NOT)],
)
def test_transfers_negatively(learning, greedy, expected):
    a, b = over_time([0.9, 0.4 + learning], [0.9, 0.4 + greedy]), over_time([0, 0.4], [0, 0.4])
    claim = transfers_negatively("GVT", a, "DDQN", b)
    assert claim.verdict == expected
    assert f"at 1,000 iterations: {learning:.3f}" in claim.evidence


@pytest.mark.parametrize(
    ("transfer", "alone", "expected"),
    [
        ([0.8, 0.2], [0.6, 0.2], REPRODUCED),
        ([0.8, 0.8], [0.8, 0.8], NOT),
        ([0.6, 0.6], [0.2, 0.2], NOT),
    ],
)
def test_optimal_only_with(transfer, alone, expected):
    a, b = (
        {f"maze {i}": over_time([0, 0], [0, end], 0.8) for i, end in enumerate(ends)}
        for ends in (transfer, alone)
    )
    claim = optimal_only_with("1-MGVT", a, "DDQN", b)
    assert claim.verdict == expected
    assert f"maze 0 {transfer[0] / 0.8:.0%} against {alone[0] / 0.8:.0%}" in claim.evidence


def test_a_claim_about_one_task_names_it():
    claim = in_task("north-east 3", Claim("GVT fails.", NOT, "0.1"))
    assert claim == Claim("In north-east 3: GVT fails.", NOT, "0.1")


# Claims on stored runs as they are, and with what they are about exchanged.


@pytest.fixture(scope="module")
def seen() -> dict[str, np.ndarray]:
    return {label: visited("rooms-exploration", label) for label in ("NT", "GVT", "1-MGVT")}


def test_stored_runs_by_chance_hardly_arrive_and_others_do(seen):
    arrived = {label: visits.arrivals(at) for label, at in seen.items()}
    assert never_arrives("NT", arrived["NT"]).verdict == REPRODUCED
    assert arrives("GVT", arrived["GVT"]).verdict == REPRODUCED
    assert never_arrives("NT", arrived["GVT"]).verdict == NOT
    assert arrives("GVT", arrived["NT"]).verdict == NOT
    # the same runs cut off before anyone can have arrived: twenty steps from corner to corner
    early = visits.arrivals(seen["GVT"][:, :12])
    assert arrives("GVT", early).verdict == NOT
    assert "0 of 20 runs arrive at least once" in arrives("GVT", early).evidence


def test_stored_visits_gather_at_the_door_that_is_there(seen):
    even = visits.uniform_share_at_door()

    def judged(label: str, door: float) -> str:
        return gathers_at_door(label, visits.share_at_door(seen[label], door), even).verdict

    assert judged("GVT", 5.0) == judged("1-MGVT", 5.0) == REPRODUCED
    assert judged("NT", 5.0) == NOT
    # a door where there is none
    assert judged("GVT", 8.0) == NOT


def test_stored_coverage_the_other_way_round_is_not_reproduced(seen):
    measures = {"cells": visits.cells_visited, "effective": visits.effective_cells}

    def claim(first: str, second: str) -> Claim:
        pairs = {name: (f(seen[first]), f(seen[second])) for name, f in measures.items()}
        return covers_more(first, second, pairs)

    assert claim("1-MGVT", "GVT").verdict == REPRODUCED
    assert claim("GVT", "1-MGVT").verdict == NOT
    cells = visits.cells_visited(seen["1-MGVT"]).mean()
    assert f"cells {cells:.1f} against" in claim("1-MGVT", "GVT").evidence
