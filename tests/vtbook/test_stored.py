"""Stored results as pages read them: the same as the store's, each read once."""

import pytest
from attrs import evolve

from vtbook import claims, stored
from vtbook.experiments.cartpole import CARTPOLE_INGREDIENTS as HERE
from vtlab import store
from vtlib.files import TornResult

LABELS = ["GVT, launch defaults", "1-MGVT, launch defaults"]


@pytest.fixture
def reads(monkeypatch):
    """The names of what is read from its file, when nothing was read before."""
    names, read = [], store.read
    monkeypatch.setattr(stored, "_READ", {})
    monkeypatch.setattr(store, "read", lambda path: (names.append(path.name), read(path))[1])
    return names


def test_a_result_is_read_once_and_nobody_changes_it_for_others(reads):
    first = stored.returns(HERE, LABELS[0])
    assert first.identical(store.returns(HERE, LABELS[0]))
    reads.clear()
    first["learning"] = 0 * first.learning
    assert stored.returns(HERE, LABELS[0]).learning.any()
    stored.returns(HERE, LABELS[1])
    assert reads == [LABELS[1]]


def test_what_is_configured_otherwise_is_refused_although_it_was_read(reads):
    stored.load(HERE, LABELS[0])
    with pytest.raises(TornResult, match="iterations"):
        stored.load(evolve(HERE, iterations=500), LABELS[0])
    stored.load(HERE, LABELS[0])
    assert len(reads) == 2


def test_runs_are_found_by_what_was_changed(reads):
    changed = claims.changes_of(HERE, "GVT", -1.0)
    assert list(changed) == ["from the prior, no clip", "launch defaults"]
    assert changed["launch defaults"].stored.identical(stored.returns(HERE, LABELS[0]))
    assert changed["launch defaults"].floor == -1.0
    assert sorted(reads) == sorted(["tasks", *HERE.algorithms])
