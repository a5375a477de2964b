"""Stored results computed anew: what is the same, and every kind of fault that must be found."""

from importlib import import_module

import numpy as np
import pytest
import torch
from attrs import evolve

from vtbook.experiments.rooms import ROOMS_EVALUATION, THREE_ROOMS
from vtlab import run, sources, store, units
from vtlab import verify as module
from vtlab.envs.rooms import Rooms
from vtlab.native.runs import NativeRun
from vtlab.verify import Verdict, check, compare, live_check
from vtlib import baselines, rng
from vtlib.priors import MixturePrior

transfer = import_module("vtlib.transfer")  # the package has a function of that name
EVERY, ROOMS = range(3), ROOMS_EVALUATION
KINDS = {
    "tiny/GVT": "fingerprints greedy iterations learning run",
    "tiny/DDQN": "fingerprints greedy learning",
    "tiny/tasks": "pole_mass optimum sources",
    "tiny-pool/sources": (
        "fingerprints fresh greedy index iterations pole_mass optimum passes solved weights"
    ),
}


@pytest.fixture(scope="module")
def anew(tiny, computed):
    """Results computed anew, once for all tests of what is stored."""
    owners = {"sources": tiny.pool, "tasks": tiny, "GVT": tiny, "DDQN": tiny}
    return {x: module._computed(o, x, EVERY, computed, False) for x, o in owners.items()}


@pytest.fixture
def checked(tiny, stored, rewrite, anew):
    """The verdict on a result after some changes, by somebody who has renewed its digest."""

    def check(name, **changes):
        rewrite(name, **changes)
        owner, label = tiny.pool if "pool" in name else tiny, name.split("/")[1]
        return compare(
            owner, *store.stored(owner, label, stored), anew[label], EVERY, store.machine()
        )

    return check


@pytest.mark.parametrize(
    ("name", "key"), [(name, key) for name, keys in KINDS.items() for key in keys.split()]
)
def test_a_number_that_was_altered_is_found(stored, checked, name, key):
    altered = store.read(stored / name)[0][key]
    shared = (name, key) == ("tiny/GVT", "iterations")
    last = (altered if shared else altered[1:2]).reshape(-1)[-1:]
    last += np.asarray(1 if last.dtype.kind in "ib" else 0.1, last.dtype)
    rows = [0, 1, 2] if shared else [1]
    assert checked(name, **{key: altered}) == (False, f"DIFFERS in {key} of {rows}")


def test_what_is_equal_but_for_rounding_is_the_same(stored, checked):
    learning = store.read(stored / "tiny/GVT")[0]["learning"]
    assert checked("tiny/GVT", learning=learning * (1 + 1e-5)) == (True, "3 of 3 equal")


def test_swapped_results_and_runs_or_arrays_left_out_are_found(stored, checked):
    others = store.read(stored / "tiny/DDQN")[0]
    assert not checked("tiny/GVT", **others).same
    fewer = {key: x if key == "iterations" else x[[0, 2]] for key, x in others.items()}
    assert checked("tiny/DDQN", **fewer).said == "DIFFERS: not all its arrays hold 3 rows"
    for changes in ({"greedy": None}, {"more": np.zeros(3)}, {"greedy": np.zeros((3, 1))}):
        assert "names or the shapes" in checked("tiny/DDQN", **{**others, **changes}).said


def test_another_evaluation_and_another_pool_are_found(tiny, stored, rewrite, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr(run, "EVALUATION_EPISODES", 11)
        assert check(tiny, "DDQN", [0], stored) == (False, "DIFFERS in greedy of [0]")
    rewrite("tiny-pool/sources", weights=store.weights(tiny.pool, stored)[::-1])
    for label in ("sources", "GVT"):
        assert not check(tiny if label == "GVT" else tiny.pool, label, root=stored).same


def test_a_fault_that_shows_late_is_found_in_whole_runs(tiny, stored, monkeypatch):
    real = baselines.DDQN.learn

    def late(self, transition):
        real(self, transition)
        if self._steps == 205:
            self.mu = -self.mu

    monkeypatch.setattr(baselines.DDQN, "learn", late)
    assert check(tiny, "DDQN", [0], stored, quick=True).same
    assert not check(tiny, "DDQN", [0], stored).same


# What stands in for a function, which is the first argument.
FAULTS = {
    "psi": (transfer, "td_gradients", lambda real, *x: real(*x[:3], 0.5 * x[3], *x[4:])),
    "lambda": (MixturePrior, "pull", lambda real, *x: 2 * real(*x)),
    "walls": (Rooms, "_blocked", lambda real, *x: torch.zeros_like(real(*x))),
    "seed": (rng, "generator", lambda real, name, row, role: real(name, row + 1, role)),
    "order in the kernels": (NativeRun, "_numbers", lambda real, *x: real(*x)[::-1].copy()),
    "seed of sources": (sources, "AttemptRng", lambda real, name, *x: real(name + "x", *x)),
}


@pytest.mark.parametrize(("place", "name", "faulty"), FAULTS.values(), ids=FAULTS)
def test_a_fault_is_found_in_the_heads_of_results_of_any_processor(
    place, name, faulty, monkeypatch
):
    if place is not NativeRun:  # faults of the engine do not reach the kernels
        monkeypatch.setattr(run, "prepare_natively", lambda *_: None)
    result = (THREE_ROOMS, "sources") if place is sources else (ROOMS, "1-MGVT")
    assert check(*result, range(4), quick=True).same
    real = getattr(place, name)
    monkeypatch.setattr(place, name, lambda *arguments: faulty(real, *arguments))
    assert not check(*result, range(4), quick=True).same


def elsewhere(*differ, earned=None, rows=range(20), machine=None) -> Verdict:
    """Verdict where another processor computes anew; from which print on how many runs differ."""
    old, note = store.stored(ROOMS, "NT")
    new = {k: x.copy() if k == "iterations" else x[rows].copy() for k, x in old.items()}
    for begin, count in differ:
        new["fingerprints"][:count, begin:] *= 1.01
    if earned is not None:
        for key in ("learning", "greedy"):
            new[key][:] = earned(new[key])
    return compare(ROOMS, old, note, new, rows, machine or {"processor": "of another kind"})


def test_elsewhere_runs_begin_alike_and_are_equal_in_distribution():
    others = "the others but for rounding"
    assert elsewhere((2, 20)) == (True, f"0 of 20 equal, {others}")
    assert elsewhere((1, 10)) == (True, f"10 of 20 equal, {others}")
    begun = "DIFFERS from the first iterations on"
    assert elsewhere((1, 11)) == (False, f"{begun}: 9 of 20 equal")
    assert elsewhere((0, 1)) == (False, f"{begun}: 19 of 20 equal")
    assert elsewhere(earned=lambda x: x[::-1]).same
    said = elsewhere(earned=lambda x: x + np.float32(0.4)).said
    assert said.startswith("DIFFERS in distribution: 0 of 20 equal, p = ")
    # too few to tell
    assert elsewhere(earned=lambda x: x + 0.4, rows=range(3)).same


def test_the_same_arithmetic_excuses_nothing():
    there = store.stored(ROOMS, "NT")[1]["machine"]
    assert not elsewhere((2, 1), machine=there).same
    for other in ({"torch": "1.0"}, {"kernels": "none"}):
        assert elsewhere((2, 1), machine={**there, **other}).same


def test_the_live_check_says_what_was_found(tiny, stored, rewrite):
    prints = store.read(stored / "tiny/GVT")[0]["fingerprints"]
    prints[1, 1, 0] += 0.1
    rewrite("tiny/GVT", fingerprints=prints)
    for member, outcome in ((0, "has"), (1, "does NOT have")):
        line = f"Run {member} of GVT, computed anew just now, {outcome} the stored fingerprints."
        assert live_check(tiny, "GVT", member, stored) == line


def test_runs_of_the_engine_are_computed_in_the_batches_of_the_store(tiny):
    def members(label, **changes):
        return [list(x.members) for x in units.units_with(evolve(tiny, **changes), label, [1, 2])]

    assert members("GVT") == [[1, 2]]  # each alone
    # as they are where visits are asked for
    assert members("DDQN") == members("GVT", visits=True) == [[0, 1], [2]]
