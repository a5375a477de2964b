"""Tables: facts counted once."""

import pytest

from vtbook import tables
from vtbook.claims import NOT, REPRODUCED, STRONGER, UNDECIDED, Claim
from vtlab.stats import Interval

IN, OUT, ACROSS = Interval(0.5, 0.4, 0.6), Interval(1.5, 1.4, 1.6), Interval(0.95, 0.8, 1.1)


def claim_of(text, number, **more):
    return Claim(text, "", number, None, 0.0, 1.0, "high", **more)


def test_the_tally_counts_the_thesis_own_facts():
    page = [claim_of(*each) for each in (("A", IN), ("B", OUT), ("C", ACROSS))]
    page += [claim_of("D", Interval(-2, -3, -1)), claim_of("E", IN, ours=True)]
    # what another page says in the same words is another fact
    for pages in ([page], [page, [claim_of("A", IN)]]):
        expected = {REPRODUCED: len(pages), STRONGER: 1, UNDECIDED: 1, NOT: 1}
        assert tables.tally(pages) == expected


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
    assert tables.fact_verdicts(rows) == [verdict]
    assert sum(tables.tally([rows]).values()) == 1
