"""The pages' claims: the published curves keep each of them, and pages tell all of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from vtbook import judged, visits
from vtbook.claims import NOT, REPRODUCED, UNDECIDED, Claim, Runs
from vtbook.experiments.grids import count_name
from vtbook.experiments.rooms import ROOMS_EXPLORATION, ROOMS_SOURCES
from vtlib.experiments import returns

BOOK = Path(__file__).parents[2] / "book"


@pytest.fixture(scope="module", params=list(judged.PAGES))
def page(request) -> tuple[str, list[Claim]]:
    return request.param, judged.PAGES[request.param]()


def test_the_published_curves_keep_every_claim_of_the_thesis(page):
    # a bound that the thesis' own figure misses would be no reading of its words
    for claim in page[1]:
        if claim.printed is not None:
            assert claim.judge(claim.printed) != NOT, (claim.text, claim.printed)


def test_every_claim_can_be_told_once_on_the_page_of_its_experiment(page):
    name, claims = page
    assert len({(one.text, one.number) for one in claims}) == len(claims) > 0
    assert f"judged.{name}()" in (BOOK / f"{name}.md").read_text(encoding="utf-8")
    for one in claims:
        assert one.text.endswith(".")
        assert not one.number.endswith(".")
        assert "published" in one.found
        assert np.isfinite(one.low) or np.isfinite(one.high)
        assert one.low < one.high
        for number in (*one.found.values(), *([] if one.printed is None else [one.printed])):
            assert number.low <= number.centre <= number.high
            assert np.isfinite(number).all()


def test_verdicts_are_undecided_only_where_a_bound_lies_within_the_interval(page):
    for one in page[1]:
        for protocol, number in one.found.items():
            across = any(number.low < bound <= number.high for bound in (one.low, one.high))
            if one.verdict(protocol) == UNDECIDED:
                assert across
            elif one.verdict(protocol) == REPRODUCED:
                assert one.low <= number.low <= number.high <= one.high


def test_stored_visits_gather_where_the_door_is_and_chance_hardly_arrives():
    stored = ROOMS_EXPLORATION.published
    seen = {label: returns(stored, label).visited.values for label in ("NT", "GVT")}
    even = visits.uniform_share_at_door()
    at_door = {x: visits.share_at_door(places, 5.0).mean() / even for x, places in seen.items()}
    assert at_door["GVT"] > 1.2 > at_door["NT"]
    assert visits.share_at_door(seen["GVT"], 8.0).mean() < even
    # cut off before anyone can have come from corner to corner
    assert not visits.arrivals(seen["GVT"][:, :12]).any()


def test_the_number_of_sources_is_judged_by_the_runs_of_each_protocol():
    claim = judged.rooms_number_of_sources()[0]
    for protocol, experiment in ROOMS_SOURCES._asdict().items():
        pair = [Runs(returns(experiment, count_name(x, 2))) for x in ("GVT", "1-MGVT")]
        assert claim.found[protocol] == Runs.ratio(*pair, judged.rooms.SOURCES_AT[0])
