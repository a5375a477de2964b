"""Tables: facts counted once, and costs added up."""

import re
from html import unescape

import pytest

from vtbook import tables
from vtbook.claims import NOT, REPRODUCED, STRONGER, UNDECIDED, Claim
from vtlab.stats import Interval


def rows_of(html):
    """Text of every cell, row by row, the head first."""
    shown = re.sub("<span class='head'>.*?</span>", "", html)
    rows = re.findall(r"<tr>(.*?)</tr>", shown)
    return [[unescape(x) for x in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row)] for row in rows]


IN, OUT, ACROSS = Interval(0.5, 0.4, 0.6), Interval(1.5, 1.4, 1.6), Interval(0.95, 0.8, 1.1)


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
