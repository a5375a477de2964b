"""Experiments computed from nothing beside what is stored of them; test_cli.py has the report."""

import numpy as np
import pytest
from attrs import evolve

from vtlab import store
from vtlab.reproduce import first_runs, reproduce


def test_what_is_computed_anew_is_compared_and_what_differs_is_named(
    tiny, stored, rewrite, here, tmp_path
):
    few = evolve(tiny, algorithms={label: tiny.algorithms[label] for label in ("NT", "GVT")})
    store.remove(stored / "tiny/NT")
    rewrite("tiny/GVT", greedy=np.full((3, 11), 0.95, np.float32))
    comparisons = reproduce([few], stored, tmp_path / "fresh", 1, here)
    assert {c.label: c.verdict for c in comparisons} == {
        "sources": (True, "3 of 3 equal"),
        "tasks": (True, "1 of 1 equal"),
        "NT": (True, "nothing stored to compare with"),
        "GVT": (False, "DIFFERS in greedy of [0]"),
    }
    assert all(c.seconds >= 0 and 10 < c.megabytes < 5000 for c in comparisons)
    with pytest.raises(ValueError, match="others than themselves"):
        reproduce([few], stored, stored / ".." / stored.name)


def test_first_runs_are_whole_tasks_and_no_more_than_there_are(tiny):
    many = evolve(tiny, runs=20)
    assert [first_runs(many, runs).runs for runs in (3, 99)] == [3, 20]
    assert first_runs(evolve(many, runs_per_task=5), 6).runs == 10
