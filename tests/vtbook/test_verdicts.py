"""The pages' claims: the published curves keep each of them, and pages tell all of them."""

from pathlib import Path

import numpy as np
import pytest

from vtbook import verdicts
from vtbook.claims import NOT

BOOK = Path(__file__).parents[2] / "book"


@pytest.mark.parametrize("page", verdicts.PAGES)
def test_claims_that_one_number_decides_count_as_one_fact(page):
    facts: dict[tuple, set[str]] = {}
    for claim in verdicts.PAGES[page]():
        facts.setdefault((claim.measure, claim.number), set()).add(claim.fact)
    assert all(len(names) == 1 for names in facts.values()), facts


@pytest.mark.parametrize("page", verdicts.PAGES)
def test_every_claim_can_be_told_once_and_the_published_curves_keep_it(page):
    claims = verdicts.PAGES[page]()
    assert len({(claim.text, claim.measure) for claim in claims}) == len(claims) > 0
    assert f"<claims-{page}>" in (BOOK / f"{page}.md").read_text(encoding="utf-8")
    for claim in claims:
        assert claim.low <= claim.high
        assert np.isfinite([claim.low, claim.high]).any()
        # a bound that the thesis' own figure misses would be no reading of its words, but what
        # "significant" means is no choice of ours: there the figure contradicts the words
        misses = claim.printed is not None and claim.judge(claim.printed) == NOT
        assert misses == ("significant" in claim.text), (claim.text, claim.printed)
        for number in (claim.number, claim.printed or (0, 0, 0)):
            assert np.isfinite(number).all()
            assert number[1] <= number[0] <= number[2]
