"""The pages' claims: no verdict changes unnoticed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from vtlib import visits
from vtlib.claims import NOT, REPRODUCED, Claim, Runs
from vtlib.experiments import judged, returns
from vtlib.experiments.rooms import ROOMS_EXPLORATION, ROOMS_SOURCES, count_name

TESTS = Path(__file__).parents[1]
BOOK = TESTS.parent / "book"


@pytest.fixture(scope="module")
def found() -> dict[str, list[Claim]]:
    return {page: judge() for page, judge in judged.PAGES.items()}


def test_a_changed_verdict_is_acknowledged(found):
    # to acknowledge one: say so in CHANGELOG.md and write it into tests/verdicts.json
    verdicts = {page: {one.text: one.verdict for one in each} for page, each in found.items()}
    assert verdicts == json.loads((TESTS / "verdicts.json").read_text(encoding="utf-8"))


def test_every_claim_stands_once_on_the_page_of_its_experiment(found):
    for page, each in found.items():
        assert len({one.text for one in each}) == len(each) > 0
        assert f"judged.{page}()" in (BOOK / f"{page}.md").read_text(encoding="utf-8")


def test_stored_visits_gather_where_the_door_is_and_chance_hardly_arrives():
    seen = {label: returns(ROOMS_EXPLORATION, label).visited.values for label in ("NT", "GVT")}
    even = visits.uniform_share_at_door()

    def gathers(label: str, door: float) -> str:
        share = visits.share_at_door(seen[label], door)
        return judged.gathers_at_door(label, share, even).verdict

    assert gathers("GVT", 5.0) == REPRODUCED
    assert gathers("NT", 5.0) == gathers("GVT", 8.0) == NOT
    # cut off before anyone can have come from corner to corner
    assert judged.arrives("GVT", visits.arrivals(seen["GVT"][:, :12])).verdict == NOT


def test_the_number_of_sources_is_judged_by_the_runs_of_each_protocol():
    claim = judged.rooms_number_of_sources()[0]
    for protocol, experiment in ROOMS_SOURCES._asdict().items():
        pair = [Runs(returns(experiment, count_name(x, 2))) for x in ("GVT", "1-MGVT")]
        assert claim.found[protocol] == Runs.ratio(*pair, judged.SOURCES_AT[0])
