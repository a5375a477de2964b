"""What the stored runs took: every experiment once, every pool at the first that needs it."""

from __future__ import annotations

import pytest

from vtlib import store
from vtlib.experiments import EXPERIMENTS, POOLS
from vtlib.experiments.costs import costs, minutes, table


def test_nothing_is_counted_twice_and_nothing_left_out():
    root = store.results_folder()
    stored = sum(store.provenance(p.with_suffix(""))["seconds"] for p in root.rglob("*.json"))
    found = costs()
    assert sum(c.sources + c.computed for c in found) == pytest.approx(stored)
    assert [c.name for c in found] == list(EXPERIMENTS)
    assert sum(c.sources > 0 for c in found) == len(POOLS)


def test_the_table_shows_minutes_of_two_cores():
    first = costs()[0]
    assert minutes(240) == 2
    text = table([first])
    assert f"{minutes(first.sources + first.computed):.0f} min" in text
    assert "rooms-evaluation" in text
    assert "160" in text  # 8 algorithms of 20 runs
