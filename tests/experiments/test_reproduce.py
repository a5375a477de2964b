"""Experiments computed from nothing beside what is stored of them."""

from __future__ import annotations

import numpy as np
import pytest
from attrs import evolve

from vtlib.experiments import store
from vtlib.experiments.reproduce import (
    Comparison,
    compare,
    differing,
    first_runs,
    report,
    reproduce,
)

RETURNS = np.random.default_rng(0).normal(0.5, 0.1, 20)
OTHER = np.random.default_rng(1).permutation(RETURNS)


def compared(tiny, tmp_path, old, new, label="DDQN", runs=20, processor="another") -> Comparison:
    """A stored result against one computed anew, both made up."""
    many = evolve(tiny, runs=20, pool=evolve(tiny.pool, count=20))
    few = first_runs(many, runs)
    owner, fresh = (many.pool, many.pool) if label == "sources" else (many, few)
    machines = {"old": {"processor": "this one"}, "new": {"processor": processor}}
    for folder, whose, arrays in (("old", owner, old), ("new", fresh, new)):
        note = {"config": store.config_of(whose, label), "seconds": 12.0, "megabytes": 300}
        path = store.path_of(whose, label, tmp_path / folder)
        store.save(path, arrays, {**note, "machine": machines[folder]})
    return compare(owner, fresh, label, tmp_path / "old", tmp_path / "new")


def recorded(returns: np.ndarray, greedy: np.ndarray = RETURNS) -> store.Arrays:
    """Two iterations of runs whose heads are alike."""
    curves = {"learning": np.stack([returns, returns], 1), "greedy": np.stack([greedy, greedy], 1)}
    return {
        "run": np.arange(len(returns)),
        "iterations": np.array([2_000, 4_000]),
        **{key: curve.astype(np.float32) for key, curve in curves.items()},
    }


@pytest.mark.parametrize(
    ("new", "verdict"),
    [
        (recorded(RETURNS), "identical"),
        (recorded(RETURNS + 1e-5), "equal up to rounding"),
        (recorded(OTHER), "equal in distribution"),
        (recorded(RETURNS - 0.2), "DIFFERENT"),
        (recorded(OTHER, RETURNS - 0.2), "DIFFERENT"),
    ],
)
def test_runs_are_compared_by_their_bits_their_values_and_their_distribution(
    tiny, tmp_path, new, verdict
):
    found = compared(tiny, tmp_path, recorded(RETURNS), new)
    assert verdict in report([found])[1]
    assert differing([found]) == ([found] if verdict == "DIFFERENT" else [])
    # the more is compared, the stronger must a difference be
    assert differing([evolve(found, p=0.004), *[evolve(found, p=0.9)] * 9]) == []
    assert (found.p is None) == (found.verdict == verdict)


def test_both_means_are_named(tiny, tmp_path):
    found = compared(tiny, tmp_path, recorded(RETURNS), recorded(OTHER, RETURNS - 0.2))
    assert found.verdict == (
        "0 of 20 alike, the others up to iteration 1,999 or more, and then "
        "learning 0.4817 stored, 0.4817 anew; greedy 0.4817 stored, 0.2817 anew"
    )


def test_a_difference_is_told_among_all_results_of_the_book(tiny, tmp_path):
    found = compared(tiny, tmp_path, recorded(RETURNS), recorded(RETURNS - 0.4, RETURNS - 0.4))
    assert differing([found, *[evolve(found, p=0.9)] * 400]) == [found]


def test_the_same_processor_excuses_nothing(tiny, tmp_path):
    found = compared(tiny, tmp_path, recorded(RETURNS), recorded(OTHER), processor="this one")
    assert report([found])[1].startswith("  DDQN: DIFFERENT: 19 of 20 differ, number 0 first: lear")
    assert differing([found, *[evolve(found, different=False)] * 99]) == [found]


def test_few_runs_cannot_tell_and_it_is_said(tiny, tmp_path):
    found = compared(tiny, tmp_path, recorded(RETURNS), recorded(RETURNS[:3] - 0.2), runs=3)
    assert report([found])[1].endswith(": too few runs to tell")
    assert differing([found]) == []
    found = compared(tiny, tmp_path / "one", recorded(RETURNS), recorded(RETURNS[:1] - 0.2), runs=1)
    assert report([found])[1].endswith(": too few runs to tell")


def test_a_forged_curve_is_named_however_few_runs_are_computed(tiny, stored, here, tmp_path):
    """Twice: both curves, and greedy alone."""
    for keys in (("learning", "greedy"), ("greedy",)):
        arrays, note = store.read(stored / "tiny/GVT")
        store.remove(stored / "tiny/GVT")
        store.save(stored / "tiny/GVT", arrays | {k: 0 * arrays[k] + 0.95 for k in keys}, note)
        found = reproduce([tiny], stored, tmp_path / "two", 2, scheduler=here, quiet=True)
        (bad,) = differing(found)
        assert (bad.label, bad.different) == ("GVT", True)
        assert f"{sorted(keys)[0]} at iteration 20 is 0.95, anew" in bad.verdict


def test_other_tasks_always_differ(tiny, tmp_path):
    old, new = {"optimum": np.ones(20)}, {"optimum": np.full(20, 0.5)}
    found = compared(tiny, tmp_path, old, new, "tasks")
    assert found.verdict == "20 of 20 differ, number 0 first: optimum is 1, anew 0.5"
    assert found.different


def test_fewer_runs_are_compared_with_the_first_of_the_stored(tiny, tmp_path):
    few = recorded(RETURNS[:3])
    assert compared(tiny, tmp_path, recorded(RETURNS), few, runs=3).verdict == "identical"


def test_first_runs_are_whole_tasks_and_no_more_than_there_are(tiny):
    many = evolve(tiny, runs=20)
    assert [first_runs(many, runs).runs for runs in (3, 99)] == [3, 20]
    assert first_runs(evolve(many, runs_per_task=5), 6).runs == 10


def test_reproduce_computes_anew_and_compares(tiny, stored, here, tmp_path):
    store.remove(stored / "tiny/NT")
    options = {"scheduler": here, "quiet": True}
    found = reproduce([tiny], stored, tmp_path / "fresh", **options)
    verdicts = {one.label: one.verdict for one in found}
    assert verdicts.pop("NT") == "nothing stored to compare with"
    assert set(verdicts.values()) == {"identical"}
    first = reproduce([tiny], stored, tmp_path / "one", 1, **options)
    assert {one.verdict for one in first if one.owner == "tiny-pool"} == {"identical"}
    assert len(store.read(tmp_path / "one" / "tiny" / "GVT")[0]["run"]) == 1
    assert differing(first) == []


def test_the_report_adds_up_an_experiment():
    each = [
        Comparison("tiny", "NT", 10.0, 200, "identical"),
        Comparison("tiny", "GVT", 20.0, 300, "nothing stored to compare with"),
    ]
    first, *others, last = report(each)
    assert first == "tiny: 30 s of one core, 300 MB at most in a process"
    assert others == ["  NT: identical", "  GVT: nothing stored to compare with"]
    assert last.startswith("2 results compared, none differs")
