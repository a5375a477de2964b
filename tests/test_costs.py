"""What the stored runs took: every experiment once, every pool at the first that needs it."""

from __future__ import annotations

import pytest

from vtlib import store
from vtlib.experiments import EXPERIMENTS, POOLS
from vtlib.experiments.costs import Cost, costs, minutes, table


def test_nothing_is_counted_twice_and_nothing_left_out():
    root = store.results_folder()
    stored = sum(store.provenance(p.with_suffix(""))["seconds"] for p in root.rglob("*.json"))
    found = costs()
    assert sum(c.sources + c.computed for c in found) == pytest.approx(stored)
    assert [c.name for c in found] == list(EXPERIMENTS)
    assert sum(c.sources > 0 for c in found) == len(POOLS)


def test_the_table_shows_minutes_of_two_cores():
    assert minutes(240) == 2
    text = table([Cost("one", 160, 1_600_000, 240.0, 360.0), Cost("two", 20, 200_000, 0.0, 120.0)])
    for shown in ("one", "160", "1.6 million", "2 min", "3 min", "5 min", "as above", "1 min"):
        assert f">{shown}<" in text.replace("\u00a0", " ")
    assert " min<" not in text, "a line may break there"
