"""What is noted of runs that were computed anew."""

import numpy as np
import pytest

from vtlib.experiments import store
from vtlib.experiments.ledger import FIELDS, NAME, record, recorded
from vtlib.experiments.whole import Whole


def test_members_are_noted_once_and_the_farthest_counts_until_a_result_is_stored_anew(
    tiny, stored, rewrite
):
    def noted(*found) -> dict[str, str]:
        record(tiny, "GVT", Whole(*found), stored)
        return {x["member"]: x["alike_until"] for x in recorded([(tiny, "GVT")], stored)}

    assert recorded([(tiny, "GVT")], stored) == []
    assert noted([2], {1: 49}, {0: "greedy is 1, anew 2"}) == {"1": "49", "2": "end"}
    assert noted([1], {2: 49}, {}) == {"1": "end", "2": "end"}
    assert recorded([(tiny, "NT"), (tiny.pool, "sources")], stored) == []
    (line, _) = recorded([(tiny, "GVT")], stored)
    assert line["processor"] == store.machine()["processor"]
    rewrite("tiny/GVT", greedy=np.ones(3))
    assert noted([], {1: 199}, {}) == {"1": "199"}


def test_a_torn_list_is_refused(tiny, stored):
    (stored / NAME).write_text(",".join(FIELDS) + "\ntiny/GVT,0,end\n")
    with pytest.raises(store.TornResult, match="each line needs result, member"):
        recorded([(tiny, "GVT")], stored)
