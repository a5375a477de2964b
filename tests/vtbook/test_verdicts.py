"""The pages' claims: the published curves keep each of them, and pages tell all of them."""

from pathlib import Path

import numpy as np
import pytest

from vtbook import verdicts
from vtbook.claims import NOT

BOOK = Path(__file__).parents[2] / "book"


@pytest.mark.parametrize("page", verdicts.PAGES)
def test_every_claim_can_be_told_once_and_the_published_curves_keep_it(page):
    claims = verdicts.PAGES[page]()
    assert len({(one.text, one.measure) for one in claims}) == len(claims) > 0
    assert f"verdicts.{page}()" in (BOOK / f"{page}.md").read_text(encoding="utf-8")
    for one in claims:
        assert "published" in one.numbers
        assert one.low < one.high
        assert np.isfinite([one.low, one.high]).any()
        # a bound that the thesis' own figure misses would be no reading of its words
        assert one.printed is None or one.judge(one.printed) != NOT, (one.text, one.printed)
        for number in (*one.numbers.values(), one.printed or (0, 0, 0)):
            assert np.isfinite(number).all()
            assert number[1] <= number[0] <= number[2]
