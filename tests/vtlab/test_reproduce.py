"""Experiments computed from nothing beside what is stored of them."""

import numpy as np
import pytest
from attrs import evolve

from vtlab import store, whole
from vtlab.reproduce import compare, differing, first_runs, report, reproduce

RETURNS = np.random.default_rng(0).normal(0.5, 0.1, 20)
OTHER = np.random.default_rng(1).permutation(RETURNS)


@pytest.fixture
def compared(tiny, tmp_path, monkeypatch):
    """Some runs computed anew, beside the stored ones with returns as above, both made up."""

    def call(new, processor="another", draws=20_000):
        monkeypatch.setattr(whole, "DRAWS", draws)
        many = evolve(tiny, runs=20)
        few = first_runs(many, len(new["run"]))
        both = ("old", "a", many, recorded(RETURNS)), ("new", processor, few, new)
        for folder, name, owner, arrays in both:
            note = {**store.origin(owner, "DDQN"), "seconds": 12.0, "megabytes": 300}
            path = store.path_of(owner, "DDQN", tmp_path / folder)
            store.save(path, arrays, {**note, "machine": {"processor": name}})
        return compare(many, few, "DDQN", tmp_path / "old", tmp_path / "new")

    return call


def recorded(returns, greedy=RETURNS):
    """Two iterations of runs whose heads are alike."""
    greedy = greedy[: len(returns)]
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
        (recorded(RETURNS[:3]), "identical"),
        (recorded(RETURNS + 1e-5), "equal up to rounding"),
        (recorded(OTHER), "equal in distribution"),
        (recorded(RETURNS - 0.2), "DIFFERENT"),
        (recorded(OTHER, RETURNS - 0.2), "DIFFERENT"),
        (recorded(RETURNS[:1] - 0.2), "too few runs to tell"),
        (recorded(RETURNS[:3] - 0.2), "0 of 3 alike, the others up to iteration 1,999 or more"),
    ],
)
def test_runs_are_compared_by_their_bits_their_values_and_their_distribution(
    compared, new, verdict
):
    found = compared(new)
    assert verdict in report([found])[1]
    assert differing([found]) == ([found] if verdict == "DIFFERENT" else [])
    # the more is compared, the stronger must a difference be
    assert differing([evolve(found, p=0.004), *[evolve(found, p=0.9)] * 9]) == []
    assert (found.p is None) == (found.verdict == verdict)


def test_a_difference_is_told_among_all_results_of_the_book(compared):
    assert whole.DRAWS >= 100_000
    found = compared(recorded(RETURNS - 0.4, RETURNS - 0.4), draws=200_000)
    assert differing([found, *[evolve(found, p=0.9)] * 400]) == [found]
    assert report([found] * 2)[0] == "tiny: 24 s of one core, 300 MB at most in a process"


def test_results_are_not_compared_with_themselves(tiny, tmp_path):
    with pytest.raises(ValueError, match="others than themselves"):
        reproduce([tiny], tmp_path, tmp_path / ".." / tmp_path.name)


def test_the_same_processor_excuses_nothing(compared):
    found = compared(recorded(OTHER), "a")
    assert report([found])[1].startswith("  DDQN: DIFFERENT: 19 of 20 differ, number 0 first: lear")
    assert differing([found, *[evolve(found, different=False)] * 99]) == [found]


def test_first_runs_are_whole_tasks_and_no_more_than_there_are(tiny):
    many = evolve(tiny, runs=20)
    assert [first_runs(many, runs).runs for runs in (3, 99)] == [3, 20]
    assert first_runs(evolve(many, runs_per_task=5), 6).runs == 10
