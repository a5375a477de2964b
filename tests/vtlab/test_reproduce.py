"""Experiments computed from nothing beside what is stored of them."""

import shutil

import numpy as np
import pytest
from attrs import evolve

from vtlab import store
from vtlab.reproduce import first_runs, report, reproduce
from vtlab.verify import Verdict


def test_what_is_computed_anew_is_compared_and_what_differs_is_named(
    tiny, computed, stored, rewrite, here, tmp_path
):
    few = evolve(tiny, algorithms={label: tiny.algorithms[label] for label in ("NT", "GVT")})
    fresh = tmp_path / "fresh"
    shutil.copytree(computed / "tiny-pool", fresh / "tiny-pool")  # as if it had been interrupted
    store.remove(stored / "tiny/NT")
    rewrite("tiny/GVT", greedy=np.full((3, 11), 0.95, np.float32))
    found = reproduce([few], stored, fresh, 1, here)
    assert len(store.read(fresh / "tiny/GVT")[0]["run"]) == 1
    assert {c.label: c.verdict for c in found} == {
        "sources": (True, "3 of 3 equal"),
        "tasks": (True, "1 of 1 equal"),
        "NT": (True, "nothing stored to compare with"),
        "GVT": (False, "DIFFERS in greedy of [0]"),
    }
    assert all(c.seconds >= 0 and 10 < c.megabytes < 5000 for c in found)


def test_the_report_says_what_each_took_and_how_many_differ(tiny, computed, tmp_path, here):
    shutil.copytree(computed, tmp_path / "fresh")
    found = reproduce([tiny], computed, tmp_path / "fresh", executor=here)
    good = evolve(found[2], seconds=12.0, megabytes=300, verdict=Verdict(True, "fine"))
    bad = evolve(good, label="DDQN", verdict=Verdict(False, "DIFFERS"))
    assert report([good, bad]) == [
        "tiny: 24 s of one core, 300 MB at most in a process",
        "  NT: fine",
        "  DDQN: DIFFERS",
        "2 results compared, 1 not the same",
    ]
    assert report(found)[-1] == "6 results compared, all the same"


def test_results_are_not_compared_with_themselves(tiny, tmp_path):
    with pytest.raises(ValueError, match="others than themselves"):
        reproduce([tiny], tmp_path, tmp_path / ".." / tmp_path.name)


def test_first_runs_are_whole_tasks_and_no_more_than_there_are(tiny):
    many = evolve(tiny, runs=20)
    assert [first_runs(many, runs).runs for runs in (3, 99)] == [3, 20]
    assert first_runs(evolve(many, runs_per_task=5), 6).runs == 10
