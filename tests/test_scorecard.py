"""The scorecard: every claim with its test, and no verdict that changes without being noticed."""

from __future__ import annotations

import json
from html.parser import HTMLParser
from pathlib import Path

import pytest

from vtlib.claims import NOT, PARTLY, REPRODUCED, Claim
from vtlib.experiments import judged, scorecard

HERE = Path(__file__).parent
ACKNOWLEDGED = HERE / "verdicts.json"


@pytest.fixture(scope="module")
def found() -> dict[str, list[Claim]]:
    return scorecard.every_claim()


def test_a_changed_verdict_is_acknowledged(found):
    # to acknowledge one: say so in CHANGELOG.md and write it into tests/verdicts.json
    verdicts = {page: {one.text: one.verdict for one in each} for page, each in found.items()}
    assert verdicts == json.loads(ACKNOWLEDGED.read_text(encoding="utf-8"))


def test_every_claim_says_once_what_is_tested_and_with_which_numbers(found):
    for page, each in found.items():
        assert (HERE.parent / "book" / f"{page}.md").exists()
        assert len({one.text for one in each}) == len(each) > 0
        for one in each:
            assert one.verdict in (REPRODUCED, PARTLY, NOT)
            assert one.test.endswith(".")
            assert any(c.isdigit() for c in one.evidence)


def test_every_page_of_an_experiment_shows_its_own_claims():
    for path in (HERE.parent / "book").glob("*.md"):
        text = path.read_text(encoding="utf-8")
        if "claims.table(" in text:
            assert f"judged.{path.stem}()" in text
            assert path.stem in judged.PAGES


def test_the_table_has_a_row_for_each_claim_and_a_link_for_each_page(found):
    class Reader(HTMLParser):
        rows, links = 0, []

        def handle_starttag(self, tag, attributes):
            self.rows += tag == "tr"
            if tag == "a":
                self.links.append(dict(attributes)["href"])

    reader = Reader()
    reader.feed(scorecard.table(found))
    claims = sum(map(len, found.values()))
    assert reader.rows == 1 + len(found) + claims
    assert reader.links == [f"{page}.html#the-claims" for page in found]
    assert sum(scorecard.counts(found).values()) == claims


def test_the_bounds_have_reasons():
    table = scorecard.thresholds_table()
    assert "95% of the planned optimum" in table
    assert table.count("<tr>") == 1 + len(scorecard.THRESHOLDS)
