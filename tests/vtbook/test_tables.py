"""Tables: settings once each, costs added up, robust numbers, claims that cannot break the page."""

import re
from html import unescape

import numpy as np
import pytest

from vtbook import tables
from vtbook.claims import NOT, REPRODUCED, STRONGER, UNDECIDED, Claim
from vtbook.costs import Cost
from vtlib.stats import Interval

HOSTILE = "<script>alert('&lt;\"')</script> & <b>"
SHOWN = HOSTILE.replace("'", "’")


def rows_of(html):
    """Text of every cell, row by row, the head first."""
    shown = re.sub("<span class='head'>.*?</span>", "", html)
    rows = re.findall(r"<tr>(.*?)</tr>", shown)
    return [[unescape(x) for x in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row)] for row in rows]


IN, OUT, ACROSS = Interval(0.5, 0.4, 0.6), Interval(1.5, 1.4, 1.6), Interval(0.95, 0.8, 1.1)


def test_claims_are_told_with_what_decides_about_them():
    numbers = {"published": IN, "equations": OUT}
    overlap = {"equations": 0.567}
    claim = Claim(f"{HOSTILE} holds.", "<it> & all", numbers, ACROSS, high=1.0, overlap=overlap)
    mine = Claim("Mine.", "n", {"published": ACROSS}, None, low=0.9, ours=True)
    card = tables.claims_table([claim, mine])
    head, first, second = rows_of(card)
    assert head[1:] == ["As published", "By the equations", "Published curve"]
    assert first == [
        f"{SHOWN} holds.<br><small><it> & all: at most 1</small>",
        f"{REPRODUCED}<br><small>0.50 (0.40 to 0.60)</small>",
        f"{NOT}<br><small>1.50 (1.40 to 1.60)<br>met at 57%</small>",
        "<small>0.95 (0.80 to 1.10)</small>",
    ]
    # what was not measured in a protocol, or never published, stays empty
    verdict = f"{UNDECIDED}<br><small>0.95 (0.80 to 1.10)</small>"
    words = "Mine. <em>(a claim of this book’s)</em><br><small>n: at least 0.9</small>"
    assert second == [words, verdict, "", ""]
    assert rows_of(tables.claims_table([mine])) == [head[:3], second[:3]]
    assert not re.search("<script|<it", card)
    near = Claim("", "", {"published": Interval(0.1, -0.001, 0.2)}, Interval(2, 2, 2), low=0.0)
    row = "".join(rows_of(tables.claims_table([near]))[1])
    assert all(x in row for x in ("0.100 (−0.001 to 0.200)<", "2.00<"))


def claim_of(text, *numbers, **more):
    by_protocol = dict(zip(tables.PROTOCOLS, numbers, strict=False))
    return Claim(text, "", by_protocol, None, 0.0, 1.0, "high", **more)


def test_the_tally_counts_the_thesis_own_facts_of_a_protocol():
    below = Interval(-2, -3, -1)
    page = [claim_of("A", IN, IN), claim_of("B", IN, OUT), claim_of("C", ACROSS, OUT)]
    page += [claim_of("D", below), claim_of("E", IN, IN, ours=True)]
    # what another page says in the same words is another fact
    for pages in ([page], [page, [claim_of("A", IN, IN)]]):
        more = len(pages) - 1
        expected = {REPRODUCED: 2 + more, STRONGER: 0, UNDECIDED: 1, NOT: 1}
        assert tables.tally(pages, "published") == expected
        expected = {REPRODUCED: 1 + more, STRONGER: 2, UNDECIDED: 0, NOT: 0}
        assert tables.tally(pages, "equations") == expected


@pytest.mark.parametrize(
    ("numbers", "verdict"),
    [
        ((IN, IN), REPRODUCED),
        ((OUT, OUT), STRONGER),
        ((OUT, IN), REPRODUCED),  # one row alone is stronger
        ((IN, ACROSS), UNDECIDED),
        ((OUT, ACROSS), UNDECIDED),
        ((IN, ACROSS, Interval(-2, -3, -1)), NOT),
    ],
)
def test_a_fact_of_several_rows_counts_once_by_the_worst_of_them(numbers, verdict):
    rows = [claim_of(f"Row {i}.", x, fact="Row {}.") for i, x in enumerate(numbers)]
    assert tables.fact_verdicts(rows, "published") == [verdict]
    assert sum(tables.tally([rows], "published").values()) == 1


def test_what_sources_cost_is_told_with_what_they_save():
    steps = np.array([1_000.0, 2_000.0]), np.array([4_000.0, 5_000.0])
    pays = Cost(200_000.0, *steps, Interval(3_000.0, 100.0, 6_001.0), 1, 2)
    may, never = (pays._replace(saved=Interval(-5.0, -6.0, x)) for x in (1.0, -4.0))
    _, first, *others = rows_of(tables.cost_of_sources_table({"A": pays, "B": may, "C": never}))
    saved, solved = "3,000 (100 to 6,001)", "1 of 2; 2 without transfer"
    assert first == ["A", "200,000", "1,500", "4,500", saved, solved, "67 (34 to 2,000)"]
    assert [x[-1] for x in others] == ["not shown to pay", "never"]


def note(label, seconds, owner="rooms", **algorithm):
    machine = {"processor": f"of {owner}", "torch": "2.9", "numpy": "2.4"}
    about = {"owner": owner, "label": label, "seconds": seconds, "machine": machine}
    return about | {"config": {"algorithm": algorithm} if algorithm else {}}


def test_the_cost_adds_up_what_is_alike():
    notes = [
        note("tasks", 2.4),
        note("A-from-2", 10.3, psi=0.5),
        note("B", 5, psi=0.6),
        note("A-from-3", 20.3, psi=0.5),
        note("A-from-3", 1, "other", psi=0.5),
    ]
    versions = "torch 2.9, numpy 2.4"
    assert rows_of(tables.cost_table(notes))[1:] == [
        ["rooms/tasks", "2", "of rooms", versions],
        ["rooms/A-from-2 to A-from-3", "31", "of rooms", versions],
        ["rooms/B", "5", "of rooms", versions],
        ["other/A-from-3", "1", "of other", versions],
    ]
