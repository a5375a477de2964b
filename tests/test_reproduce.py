"""The report of ``reproduce``: identical, equal up to rounding or in distribution, different."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vtlib import store
from vtlib.baselines import MellowTDSettings
from vtlib.envs.rooms import RoomsFamily
from vtlib.experiments import EXPERIMENTS, POOLS, Experiment, reproduce, work
from vtlib.experiments.reproduce import Comparison, differing, first_runs, report
from vtlib.sources import Pool

POOL = Pool("tiny-pool", RoomsFamily(rooms=2), count=20)
TINY = Experiment(
    "tiny", POOL, RoomsFamily(rooms=2), {"NT": MellowTDSettings(epsilon_steps=100)}, runs=20
)


@pytest.fixture(autouse=True)
def tiny(monkeypatch):
    monkeypatch.setitem(EXPERIMENTS, "tiny", TINY)
    monkeypatch.setitem(POOLS, "tiny-pool", POOL)


def runs(learning: np.ndarray) -> store.Arrays:
    return {
        "run": np.arange(len(learning)),
        "iterations": np.array([100, 200]),
        "learning": np.stack([learning, learning], 1).astype(np.float32),
    }


def kept(root, arrays, owner=TINY, label="NT"):
    note = {"config": work.config_of(owner, label), "seconds": 12.0, "megabytes": 300}
    store.save(root / owner.name / label, arrays, note)


def compared(tmp_path, old, new, owner=TINY, label="NT") -> Comparison:
    kept(tmp_path / "old", old, *((TINY, "NT") if label == "NT" else (owner, label)))
    kept(tmp_path / "new", new, owner, label)
    return reproduce._compare(owner, label, tmp_path / "old", tmp_path / "new")


RETURNS = np.random.default_rng(0).normal(0.5, 0.1, 20)


def test_the_same_bits_are_identical(tmp_path):
    assert compared(tmp_path, runs(RETURNS), runs(RETURNS)).verdict == "identical"


def test_what_rounding_does_is_no_difference(tmp_path):
    found = compared(tmp_path, runs(RETURNS), runs(RETURNS + 1e-5))
    assert (found.verdict, found.p) == ("equal up to rounding", None)


def test_runs_that_went_other_ways_are_equal_in_distribution(tmp_path):
    found = compared(tmp_path, runs(RETURNS), runs(np.random.default_rng(1).permutation(RETURNS)))
    assert found.p > 0.05
    assert differing([found]) == []
    assert "equal in distribution" in report([found])[1]


def test_runs_that_earn_less_are_different(tmp_path):
    found = compared(tmp_path, runs(RETURNS), runs(RETURNS - 0.2))
    assert found.p < 0.001
    assert found.verdict == "learning returns 0.4817 stored, 0.2817 anew"
    assert differing([found]) == [found]
    assert "DIFFERENT" in report([found])[1]


def test_sources_are_compared_by_their_greedy_returns(tmp_path):
    old = {"greedy": RETURNS, "weights": np.zeros((20, 3)), "iterations": np.arange(20)}
    new = {**old, "greedy": RETURNS - 0.2}
    found = compared(tmp_path, old, new, POOL, "sources")
    assert found.verdict.startswith("greedy returns")
    assert found.p < 0.001


def test_other_tasks_always_differ(tmp_path):
    old, new = {"optimum": np.ones(20)}, {"optimum": np.full(20, 0.5)}
    found = compared(tmp_path, old, new, TINY, "tasks")
    assert (found.verdict, found.p) == ("other tasks", 0.0)


def test_fewer_runs_are_compared_with_the_first_of_the_stored(tmp_path):
    few = first_runs(TINY, 3)
    assert compared(tmp_path, runs(RETURNS), runs(RETURNS[:3]), few).verdict == "identical"


def test_first_runs_are_whole_tasks_and_no_more_than_there_are():
    assert first_runs(TINY, 3).runs == 3
    assert first_runs(TINY, 99).runs == 20
    assert first_runs(replace(TINY, runs_per_task=5), 6).runs == 10


def test_the_more_is_compared_the_stronger_must_a_difference_be():
    weak = Comparison("tiny", "NT", 1.0, 1, "learning returns", 0.004)
    assert differing([weak]) == [weak]
    assert differing([weak, *[replace(weak, p=0.9)] * 9]) == []


def test_the_report_adds_up_an_experiment():
    each = [
        Comparison("tiny", "NT", 10.0, 200, "identical"),
        Comparison("tiny", "GVT", 20.0, 300, "nothing stored to compare with"),
    ]
    assert report(each) == [
        "tiny: 30 s of one core, 300 MB at most in a process",
        "  NT: identical",
        "  GVT: nothing stored to compare with",
        "2 results compared, none differs "
        "(Kolmogorov-Smirnov distance, runs exchanged in pairs, level 0.01 over all)",
    ]
