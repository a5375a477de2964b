"""What is noted of runs that were computed anew."""

from __future__ import annotations

import numpy as np
import pytest

from vtlib.experiments import store
from vtlib.experiments.ledger import FIELDS, NAME, record, recorded
from vtlib.experiments.whole import Whole


def noted(tiny, root) -> dict[str, str]:
    return {x["member"]: x["alike_until"] for x in recorded([(tiny, "GVT")], root)}


def test_members_are_noted_once_and_the_farthest_counts(tiny, stored):
    assert noted(tiny, stored) == {}
    record(tiny, "GVT", Whole([2], {1: 49}, {0: "greedy is 1, anew 2"}), stored)
    assert noted(tiny, stored) == {"1": "49", "2": "end"}
    record(tiny, "GVT", Whole([1], {2: 49}, {}), stored)
    assert noted(tiny, stored) == {"1": "end", "2": "end"}
    assert recorded([(tiny, "NT"), (tiny.pool, "sources")], stored) == []
    (line, _) = recorded([(tiny, "GVT")], stored)
    assert line["processor"] == store.machine()["processor"]


def test_a_result_stored_anew_begins_without_lines(tiny, stored):
    record(tiny, "GVT", Whole([0, 2], {}, {}), stored)
    arrays, note = store.read(stored / "tiny/GVT")
    store.remove(stored / "tiny/GVT")
    store.save(stored / "tiny/GVT", arrays | {"greedy": arrays["greedy"] + np.float32(1)}, note)
    assert noted(tiny, stored) == {}
    record(tiny, "GVT", Whole([], {0: 199}, {}), stored)
    assert noted(tiny, stored) == {"0": "199"}


def test_a_torn_list_is_refused(tiny, stored):
    (stored / NAME).write_text(",".join(FIELDS) + "\ntiny/GVT,0,end\n")
    with pytest.raises(store.TornResult, match="each line needs result, member"):
        recorded([(tiny, "GVT")], stored)
