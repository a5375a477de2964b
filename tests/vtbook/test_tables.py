"""Tables: settings once each, costs added up, robust numbers, claims that cannot break the page."""

from __future__ import annotations

import re
from collections.abc import Mapping
from html import unescape
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pytest
from attrs import frozen
from xarray import Dataset

from vtbook import tables
from vtbook.claims import NOT, REPRODUCED, STRONGER, UNDECIDED, Claim
from vtbook.comparisons import bootstrap_interval, improvement_interval
from vtbook.costs import Cost
from vtbook.tables import NO_BREAK
from vtlib.rng import generator
from vtlib.stats import Interval, mean_interval

HOSTILE = "<script>alert('&lt;\"')</script> & <b>"


@frozen
class Good:
    lambda_: float
    family: str = "mixture"


@frozen
class Other:
    epsilon: int | None = 5


class Made(NamedTuple):
    """What the tables read of an experiment."""

    name: str = "made-up"
    runs_per_task: int = 1
    algorithms: Mapping[str, object] = MappingProxyType({})


def rows_of(html: str) -> list[list[str]]:
    """Text of every cell, row by row, the head first."""
    rows = re.findall(r"<tr>(.*?)</tr>", html.replace(NO_BREAK, " "))
    return [[unescape(x) for x in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row)] for row in rows]


def test_a_table_holds_its_cells_and_escapes_them():
    html = tables.html_table([HOSTILE], [["a & b"], [HOSTILE]])
    assert rows_of(html) == [[HOSTILE], ["a & b"], [HOSTILE]]
    assert set(re.findall(r"<\w+", html)) == {"<table", "<thead", "<tbody", "<tr", "<th", "<td"}


IN, OUT, ACROSS = Interval(0.5, 0.4, 0.6), Interval(1.5, 1.4, 1.6), Interval(0.95, 0.8, 1.1)
HEAD = ["Claim, and the number that decides", "As published", "By the equations", "Published curve"]


def test_claims_are_told_with_what_decides_about_them():
    found = {"published": IN, "equations": OUT}
    claim = Claim(f"{HOSTILE} holds.", "<it> & all", found, ACROSS, high=1.0)
    mine = Claim("Mine.", "n", {"published": ACROSS}, None, low=0.0, high=1.0, ours=True)
    plain = tables.claims_table([claim, mine])
    card = tables.scorecard_table({"rooms": ("Rooms & all", [claim]), "maze": ("Maze", [mine])})
    head, first, second = rows_of(plain)
    assert head == HEAD
    assert first == [
        f"{HOSTILE} holds.<br><small><it> & all: at most 1</small>",
        f"{REPRODUCED}<br><small>0.50 (0.40 to 0.60)</small>",
        f"{NOT}<br><small>1.50 (1.40 to 1.60)</small>",
        "<small>0.95 (0.80 to 1.10)</small>",
    ]
    # what was not measured in a protocol, or never published, stays empty
    assert second == [
        "Mine. <em>(a claim of this book's)</em><br><small>n: 0 to 1</small>",
        f"{UNDECIDED}<br><small>0.95 (0.80 to 1.10)</small>",
        "",
        "<small></small>",
    ]
    _, rooms, one, maze, other = rows_of(card)
    assert rooms == ["<a href='rooms.html#the-claims'>Rooms & all</a>"]
    assert maze == ["<a href='maze.html#the-claims'>Maze</a>"]
    assert [one, other] == [first, second]
    assert "colspan='4'" in card
    for html in (plain, card):
        assert "<script" not in html
        assert "<it" not in html
        classes = re.findall(r"class='([^']*)'", html)
        assert classes == ["claims", "verdict reproduced", "verdict not", "verdict undecided"]


def test_the_tally_counts_the_thesis_own_claims_of_a_protocol():
    bounds = {"low": 0.0, "high": 1.0, "stronger": "high"}
    claims = [
        Claim("", "", {"published": one, "equations": other}, None, **bounds)
        for one, other in ((IN, IN), (IN, OUT), (ACROSS, OUT))
    ]
    claims.append(Claim("", "", {"published": Interval(-2, -3, -1)}, None, **bounds))
    claims.append(Claim("", "", {"published": IN, "equations": IN}, None, ours=True))
    assert tables.tally(claims, "published") == {
        REPRODUCED: 2,
        STRONGER: 0,
        UNDECIDED: 1,
        NOT: 1,
    }
    assert tables.tally(claims, "equations") == {REPRODUCED: 1, STRONGER: 2, UNDECIDED: 0, NOT: 0}


class Compared:
    """What the table of overlaps reads of a figure."""

    printed: Mapping[str, None] = MappingProxyType({"GVT": None, "NT": None})

    def __init__(self, *protocols: str) -> None:
        self.protocols = protocols

    def overlap(self, protocol: str, label: str, kind: str) -> float:
        return 0.1 * len(label) + (kind == "greedy") / 100 + (protocol == "equations") / 2


def test_overlaps_have_a_row_for_each_published_curve():
    head, *rows = rows_of(tables.overlap_table({"A & B": Compared("published", "equations")}))
    assert head == ["figure", "algorithm", "return", "As published", "By the equations"]
    assert rows == [
        ["A & B", "GVT", "learning", "30%", "80%"],
        ["A & B", "GVT", "greedy", "31%", "81%"],
        ["A & B", "NT", "learning", "20%", "70%"],
        ["A & B", "NT", "greedy", "21%", "71%"],
    ]
    _, first, *_ = rows_of(tables.overlap_table({"A": Compared("published")}))
    assert first == ["A", "GVT", "learning", "30%", "not run"]


def test_what_sources_cost_is_told_with_what_they_save():
    steps = np.array([1_000.0, 2_000.0]), np.array([4_000.0, 5_000.0])
    pays = Cost(200_000.0, *steps, Interval(3_000.0, -1.0, 6_001.0), 1, 2)
    never = pays._replace(saved=Interval(-5.0, -6.0, -4.0))
    _, first, second = rows_of(tables.cost_of_sources_table({"A": pays, "B": never}))
    told = "3,000 (-1 to 6,001)"
    assert first == ["A", "200,000", "1,500", "4,500", told, "1 of 2; without 2", "67"]
    assert second[4:] == ["-5 (-6 to -4)", "1 of 2; without 2", "never"]


def test_settings_have_a_column_for_each_distinct_one_and_gaps_where_a_parameter_is_missing():
    good = Good(1e-6)
    algorithms = {"a-2": good, "b": Other(None), "a-3": good, "c": Good(0.5, "gaussian")}
    assert rows_of(tables.settings_table(Made(algorithms=algorithms))) == [
        ["parameter", "a-2 to a-3", "b", "c"],
        ["lambda_", "1e-06", "", "0.5"],
        ["family", "mixture", "", "gaussian"],
        ["epsilon", "", "", ""],
    ]


def note(owner: str, label: str, seconds: float, **algorithm: float) -> dict[str, object]:
    machine = {"processor": f"of {owner}", "torch": "2.9", "numpy": "2.4"}
    config = {"runs": 3, **({"algorithm": algorithm} if algorithm else {})}
    about = {"owner": owner, "label": label, "seconds": seconds}
    return {**about, "machine": machine, "config": config}


def test_the_cost_adds_up_what_is_alike():
    notes = [
        note("pool", "sources", 40.4),
        note("rooms", "tasks", 2),
        note("rooms", "A-from-2", 10.3, psi=0.5),
        note("rooms", "B", 5, psi=0.6),
        note("rooms", "A-from-3", 20.3, psi=0.5),
        note("other", "A-from-3", 1, psi=0.5),
    ]
    _, *rows = rows_of(tables.cost_table(notes))
    versions = "torch 2.9, numpy 2.4"
    assert rows == [
        ["pool/sources", "40", "of pool", versions],
        ["rooms/tasks", "2", "of rooms", versions],
        ["rooms/A-from-2 to A-from-3", "31", "of rooms", versions],
        ["rooms/B", "5", "of rooms", versions],
        ["other/A-from-3", "1", "of other", versions],
    ]


def earning(shares: np.ndarray) -> Dataset:
    """Runs that earn these shares of an optimum of 0.8 at 1,000 iterations, and twice at 2,000."""
    curves = 0.8 * np.stack([shares, 2 * shares], 1)
    data = {
        "learning": (("run", "iteration"), curves),
        "optimum": ("run", np.full(len(shares), 0.8)),
    }
    return Dataset(data, {"iteration": [1_000, 2_000]})


def shown(value: Interval) -> str:
    return f"{value.centre:.2f} ({value.low:.2f} to {value.high:.2f})"


def test_robust_numbers_are_those_of_the_statistics_seeded_by_the_label():
    rng = np.random.default_rng(0)
    shares = {"A": rng.random(12), "B": rng.random(12)}
    runs = {label: earning(share) for label, share in shares.items()}
    head, *rows = rows_of(tables.robust_table(Made(), runs, 2_000, "A"))
    assert head[3] == "P(better than A)"
    for (label, share), row in zip(shares.items(), rows, strict=True):
        seeded = generator("made-up", 0, f"bootstrap {label} 2000")
        middle = bootstrap_interval(2 * share, seeded)
        better = shown(improvement_interval(share, shares["A"], seeded)) if label == "B" else ""
        assert row == [label, shown(mean_interval(2 * share)), shown(middle), better]


@pytest.mark.parametrize("per_task", [4, 1])
def test_robust_numbers_of_runs_that_share_tasks_are_taken_within_tasks(per_task):
    # tasks differ by far, their runs hardly: only resampling across tasks sees much spread
    level = np.repeat([0.1, 0.5, 0.9], 4)
    runs = {"A": earning(level), "B": earning(level + np.repeat([0.02, -0.02, 0.02], 4))}
    _, _, row = rows_of(tables.robust_table(Made("m", per_task), runs, 1_000, "A"))
    low, high = (float(x) for x in re.findall(r"\d\.\d+", row[3])[1:])
    if per_task == 4:
        assert row[3] == "0.67 (0.67 to 0.67)"
    else:
        assert high - low > 0.3


def test_the_sweep_has_psi_down_and_lambda_across():
    shares = {(x, psi): np.array([psi, psi + x]) for psi in (1.0, 0.0) for x in (1e-4, 1e-6)}
    head, *rows = rows_of(tables.sweep_table(shares))
    assert head == ["", "λ = 10⁻⁶", "λ = 10⁻⁴"]
    assert [row[0] for row in rows] == ["ψ = 0", "ψ = 1"]
    assert rows[1][1:] == ["1.00 ± 0.00"] * 2
    wide = mean_interval(np.array([0.0, 0.5]))
    told = rows_of(tables.sweep_table({(1.0, 0.0): np.array([0.0, 0.5])}))[1][1]
    assert told == f"0.25 ± {wide.high - 0.25:.2f}"
