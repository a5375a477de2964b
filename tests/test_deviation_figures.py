"""What the page of deviations shows: effects paired by run, their table and their figure."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex

from vtlib.claims import Returns
from vtlib.experiments import ROOMS_DEVIATIONS, deviation_figures, named
from vtlib.experiments.deviation_figures import (
    MARKERS,
    changes_table,
    effect_of,
    effects_figure,
    every_effect,
    expectations_table,
    identical_runs,
    linked,
    outcome,
    percent,
    source_counts,
    table,
)
from vtlib.experiments.deviations import (
    COUNTS,
    DEVIATION_ITERATIONS,
    DEVIATIONS,
    HIGHER,
    LOWER,
    NONE,
    OPEN,
    Comparison,
)
from vtlib.plots import COLOURS
from vtlib.stats import Interval, mean_interval

BOOK = Path(__file__).resolve().parents[1] / "book"


def interval(low: float, high: float) -> Interval:
    return Interval(*map(np.asarray, ((low + high) / 2, low, high)))


@pytest.fixture(scope="module")
def effects() -> dict[str, list[deviation_figures.Effect]]:
    return every_effect()


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0.04, 0.08, HIGHER),
        (-0.2, -0.1, LOWER),
        (0.01, 0.04, NONE),
        (0.0, 0.0, NONE),
        (-0.04, 0.04, NONE),
        (-0.01, 0.3, OPEN),
        (0.01, 0.06, OPEN),
        (-0.06, 0.04, OPEN),
    ],
)
def test_an_effect_counts_from_its_bound_on(low: float, high: float, expected: str) -> None:
    assert outcome(interval(low, high)) == expected


def test_an_effect_is_paired_by_run_and_ends_with_the_shorter_result(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(0)
    optimum = np.array([0.5, 0.8, 1.0])
    long, short = rng.random((3, 80)), rng.random((3, 20))

    def stored(name: str, label: str) -> Returns:
        learning = {"long": long, "short": short}[name]
        at = 100 * np.arange(1, learning.shape[1] + 1)
        return Returns(at, learning, learning, optimum)

    monkeypatch.setattr(deviation_figures, "returns", stored)
    effect = effect_of(Comparison("GVT", ("short", "x"), ("long", "x")))
    assert effect.iterations == 2_000
    share = (short - long[:, :20]) / optimum[:, None]
    np.testing.assert_allclose(effect.over, mean_interval(share.mean(1)))
    np.testing.assert_allclose(effect.end, mean_interval(share[:, -1]))
    both = effect_of(Comparison("GVT", ("long", "x"), ("long", "y")))
    assert both.iterations == DEVIATION_ITERATIONS
    assert np.all(np.array(both.over) == 0)


def test_runs_are_identical_only_to_the_last_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    learning = np.random.default_rng(0).random((3, 20))
    greedy = {"here": learning.copy(), "other": learning[:, :10].copy()}
    greedy["other"][1, 9] = np.nextafter(greedy["other"][1, 9], 1)

    def stored(name: str, label: str) -> Returns:
        shared = greedy[name].shape[1]
        at = 100 * np.arange(1, shared + 1)
        return Returns(at, learning[:, :shared], greedy[name], np.ones(3))

    monkeypatch.setattr(deviation_figures, "returns", stored)
    assert identical_runs(Comparison("GVT", ("other", "x"), ("here", "x"))) == 2


def test_comparisons_are_of_runs_with_the_same_targets_and_random_numbers() -> None:
    compared = [x for one in DEVIATIONS for x in one.comparisons]
    for one in compared:
        other, here = named(one.other[0]), named(one.here[0])
        assert one.other[1] in other.algorithms
        assert one.here[1] in here.algorithms
        assert (other.stream, other.runs, other.every) == (here.stream, here.runs, here.every)
        assert one.algorithm in MARKERS
    stored = {one.other for one in compared if one.other[0] == ROOMS_DEVIATIONS.name}
    assert {label for _, label in stored} == set(ROOMS_DEVIATIONS.algorithms)


def test_what_was_computed_for_this_page_was_expected_before() -> None:
    for one in (x for deviation in DEVIATIONS for x in deviation.comparisons):
        seen_before = not one.other[0].startswith(("rooms-deviations", "rooms-corner"))
        assert one.expected in (("",) if seen_before else (LOWER, NONE, HIGHER))


def test_numbers_are_in_hundredths_with_their_interval() -> None:
    assert percent(interval(-0.1, 0.0)) == "−5.0% (−10.0 to 0.0)"
    assert percent(interval(0.0102, 0.0302)) == "+2.0% (+1.0 to +3.0)"
    assert percent(interval(-0.0001, 0.0001)) == "0.0% (0.0 to 0.0)"


def test_links_and_nothing_else_become_html() -> None:
    assert linked("a < b, [p.html#x|(5.1)]") == "a &lt; b, <a href='p.html#x'>(5.1)</a>"


class Reader(HTMLParser):
    """Rows, cells by their labels, and links of a piece of HTML."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.rows, self.links, self.labels = 0, list[str](), list[str]()
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.rows += tag == "tr"
        if tag == "a":
            self.links.append(found["href"] or "")
        if "data-label" in found:
            self.labels.append(found["data-label"] or "")


def test_the_table_has_every_deviation_with_its_effects(effects) -> None:
    html = table(effects)
    reader = Reader(html)
    assert reader.rows == 1 + len(deviation_figures.GROUPS) + 2 * len(DEVIATIONS)
    assert len(reader.labels) == 3 * len(DEVIATIONS)
    for each in effects.values():
        for effect in each:
            assert f"{percent(effect.over)} over the run, {percent(effect.end)} at the end" in html
    for link in reader.links:
        page, _, target = link.partition("#")
        label = target.removeprefix("equation-")
        text = (BOOK / page).with_suffix(".md").read_text(encoding="utf-8")
        assert f"({label})" in text or f":name: {label}" in text


def test_expectations_stand_beside_what_came(effects) -> None:
    html = expectations_table(effects)
    expected = [x for one in DEVIATIONS for x in one.comparisons if x.expected]
    assert html.count("<tr>") == 1 + len(expected)
    came = effects["Clipping of gradients"][0].outcome
    assert f"<td>Clipping of gradients: GVT</td><td>{NONE}</td><td>{came}</td>" in html


def test_the_changes_name_what_each_result_has_otherwise() -> None:
    html = changes_table()
    assert html.count("<tr>") == 1 + len(ROOMS_DEVIATIONS.algorithms)
    assert "<td>GVT-no-clip</td><td>clip = None</td>" in html
    assert "<td>1-MGVT-mean-equal</td><td>init = mean, responsibilities = equal</td>" in html
    assert "<td>GVT-by-episode</td><td>act = episode</td>" in html


def test_the_figure_draws_every_effect_with_its_interval(effects) -> None:
    figure = effects_figure(effects)
    over, end = figure.axes
    assert [x.get_text() for x in over.get_yticklabels()] == list(effects)
    shown = [one for each in effects.values() for one in each]
    for ax, kind in ((over, "over"), (end, "end")):
        assert len(ax.containers) == len(shown)
        rows = [row for row, each in enumerate(effects.values()) for _ in each]
        for drawn, effect, row in zip(ax.containers, shown, rows, strict=True):
            point, _, (bar,) = drawn.lines
            centre, low, high = map(float, getattr(effect, kind))
            assert point.get_xdata()[0] == pytest.approx(centre)
            assert abs(point.get_ydata()[0] - row) < 0.5
            np.testing.assert_allclose(sorted(bar.get_segments()[0][:, 0]), [low, high], atol=1e-9)
            assert to_hex(point.get_color()) == COLOURS[effect.comparison.algorithm].lower()
    (legend,) = figure.legends
    assert {x.get_text() for x in legend.get_texts()} == {x.comparison.algorithm for x in shown}
    assert COUNTS < 0.1


def test_sources_are_rewarded_when_their_weights_have_moved() -> None:
    sources = {
        "weights": np.array([[0.0, 0.0], [0.0, 0.1], [0.2, 0.1]]),
        "solved": np.array([False, True, True]),
        "iterations": np.array([20_000, 30_000, 20_000]),
    }
    counts = source_counts(sources, 20_000)
    assert (counts.count, counts.rewarded, counts.solved) == (3, 2, 1)
    assert source_counts(sources, 30_000).solved == 2
