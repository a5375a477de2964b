"""The scorecard: one line a claim with its verdict, and a bar of all verdicts."""

import pytest

from vtbook import scorecard
from vtbook.claims import Claim
from vtlib.stats import Interval

bs4 = pytest.importorskip("bs4")
PAGES = {
    "three_rooms": [
        Claim("Holds.", "a", {"published": Interval(0, -1, 1)}, None, -2, 2),
        Claim("<Fails>.", "b", {"published": Interval(5, 4, 6)}, None, -2, 2),
    ],
    "mazes": [Claim("Text alone.", "c", {"equations": Interval(2, 1, 3)}, None, -2, 2)],
}


def test_each_claim_is_a_line_that_unfolds_and_names_what_it_is_filtered_by():
    page = bs4.BeautifulSoup(scorecard.lines(PAGES), "html.parser")
    told = [(x["data-page"], x["data-verdict"]) for x in page.select("details")]
    assert told == [
        ("three_rooms", "reproduced"),
        ("three_rooms", "not reproduced"),
        ("mazes", "not measured"),
    ]
    claims = [x.get_text() for x in page.select("summary .claim")]
    assert claims == ["Holds.", "<Fails>.", "Text alone."]
    offered = [[x.get_text() for x in one.select("option")] for one in page.select("select")]
    assert offered == [["all", "reproduced", "not reproduced"], ["all", "Three rooms", "Mazes"]]
    assert page.select_one(".filter").has_attr("hidden")  # where no script shows it
    assert all(len(x.select("table.claims")) == 1 for x in page.select("details"))


def test_the_bar_counts_the_facts_of_both_protocols():
    (ax,) = scorecard.bar(PAGES).axes
    assert [round(x.get_width()) for x in ax.patches] == [1, 1, 1]
