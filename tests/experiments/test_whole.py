"""Whole runs computed anew: every number that could be forged, and faults that show late."""

from __future__ import annotations

import numpy as np
import pytest
from attrs import evolve

from vtbook.experiments.rooms import ROOMS_EVALUATION
from vtlib import baselines, native
from vtlib.experiments import run, sources, store, whole
from vtlib.experiments.heads import check_heads
from vtlib.experiments.whole import Whole, check_runs, verify

EVERY, ROOMS = [0, 1, 2], ROOMS_EVALUATION.published
KINDS = {
    "tiny/GVT": "fingerprints greedy iterations learning run",
    "tiny/DDQN": "fingerprints greedy learning",
    "tiny/tasks": "pole_mass optimum sources",
    "tiny-pool/sources": (
        "fingerprints fresh greedy index iterations pole_mass optimum passes solved weights"
    ),
}


def elsewhere(monkeypatch) -> None:
    """Let this be a processor of another kind, whose kernels are not the widest."""
    monkeypatch.setattr(store, "machine", lambda *_: {"processor": "another"})
    monkeypatch.setattr(native, "level", lambda: "baseline")


def test_every_result_is_what_is_stored(tiny, stored):
    found = {f"{o.name}/{label}": x for o, label, x in verify(tiny, tiny, root=stored)}
    own = [f"tiny/{label}" for label in ("tasks", *tiny.algorithms)]
    assert list(found) == ["tiny-pool/sources", *own]
    assert all(x == Whole(EVERY, {}, {}) for x in found.values())
    drawn = [x.alike for *_, x in verify(tiny, root=stored, rng=np.random.default_rng(3))]
    assert {len(one) for one in drawn} == {1}
    assert len({*map(tuple, drawn)}) > 1


@pytest.mark.parametrize(
    ("name", "key"), [(name, key) for name, keys in KINDS.items() for key in keys.split()]
)
def test_a_forged_number_is_named(tiny, stored, rewrite, name, key):
    label, forged = name.split("/")[1], store.read(stored / name)[0][key]
    shared = (label, key) == ("GVT", "iterations")
    last = (forged if shared else forged[1:2]).reshape(-1)[-1:]
    last += np.asarray(1 if last.dtype.kind in "ib" else 0.1, last.dtype)
    rewrite(name, **{key: forged})
    owner = tiny.pool if label == "sources" else tiny
    found = check_runs(owner, label, root=stored)
    assert list(found.wrong) == (EVERY if shared else [1])
    assert found.wrong[1].startswith(key)
    assert " is " in found.wrong[1]
    in_heads = label == "tasks" or key == "fingerprints"
    assert list(check_heads(owner, label, stored).wrong) == ([1] if in_heads else [])


@pytest.mark.parametrize("key", ["learning", "greedy"])
@pytest.mark.parametrize("label", ["GVT", "DDQN"])
def test_a_forged_curve_is_named_on_another_processor_too(
    tiny, stored, rewrite, label, key, monkeypatch
):
    rewrite(f"tiny/{label}", **{key: np.full((3, 11), 0.95, np.float32)})
    elsewhere(monkeypatch)
    found = check_runs(tiny, label, root=stored)
    assert list(found.wrong) == EVERY
    assert not found.parted
    assert found.wrong[0].startswith(f"{key} at iteration 20 is 0.95")


@pytest.mark.parametrize(
    ("label", "changes", "said"),
    [
        ("GVT", {"fingerprints": None}, "fingerprints is missing, anew there"),
        ("GVT", {"fingerprint": np.zeros(3)}, "fingerprint is there, anew missing"),
        *(
            (label, {key: wrong}, f"{key} is {wrong.dtype}{wrong.shape}, anew float")
            for label, key in (("GVT", "fingerprints"), ("tasks", "optimum"))
            for wrong in map(np.array, (np.zeros(0), 0.0, np.zeros((1, 3, 4)), ["x"] * 3))
        ),
    ],
)
def test_arrays_that_lack_or_have_another_shape_are_named(
    tiny, stored, rewrite, label, changes, said
):
    rewrite(f"tiny/{label}", **changes)
    found = check_runs(tiny, label, root=stored).wrong
    assert list(found) == EVERY
    assert all(what.startswith(said) for what in found.values())
    heads = [] if "fingerprint" in changes else EVERY
    assert list(check_heads(tiny, label, stored).wrong) == heads


def test_a_fault_that_shows_late_is_named(tiny, stored, monkeypatch):
    calls, real = iter(range(10**6)), baselines.DDQN.learn

    def late(self, transition):
        real(self, transition)
        if next(calls) == 205:
            self.mu = -self.mu

    monkeypatch.setattr(baselines.DDQN, "learn", late)
    assert not check_heads(tiny, "DDQN", stored).wrong
    calls = iter(range(10**6))
    found = check_runs(tiny, "DDQN", [0, 1], stored).wrong  # one batch
    assert found
    assert all("at iteration 220" in what for what in found.values())


def test_another_evaluation_is_named(tiny, stored, monkeypatch):
    monkeypatch.setattr(run, "EVALUATION_EPISODES", 11)
    for label in ("GVT", "DDQN"):
        wrong = check_runs(tiny, label, root=stored).wrong
        assert wrong
        assert all(what.startswith("greedy") for what in wrong.values())


@pytest.mark.parametrize("member", [3, -1, 1.0, None, True])
def test_members_that_are_not_there_are_refused(tiny, stored, member):
    for check in (
        lambda: check_runs(tiny, "GVT", [member], stored),
        lambda: check_heads(tiny, "GVT", stored, [member]),
    ):
        with pytest.raises(ValueError, match="member must be a whole number from 0 to 2, got"):
            check()


# --- what rounding may do ------------------------------------------------------------------------


def compared(machine="this one", processor="another", **changes) -> Whole:
    """A stored result of the rooms, and one run of it anew, which changes say to be otherwise."""
    arrays, _ = store.stored(ROOMS, "NT")
    anew = {k: v if k == "iterations" else v[[7]].copy() for k, v in arrays.items()}
    for key, places in changes.items():
        anew[key][0][places] += 0.1
    note = {"machine": {"processor": machine} if isinstance(machine, str) else machine["is"]}
    return whole.compare_runs(ROOMS, "NT", (arrays, note), anew, [7], {"processor": processor})


@pytest.mark.parametrize(
    ("changes", "parted"),
    [
        ({"learning": slice(50, None)}, 5_099),
        ({"learning": slice(50, None), "greedy": slice(40, None)}, 4_099),
        ({"learning": [-1]}, 19_999),
        ({"greedy": [3]}, 399),
        ({"fingerprints": slice(1, None), "learning": slice(0, None)}, 48),
        # for another reason
        ({"greedy": [3, 4, 9]}, None),
        ({"learning": [30]}, None),
        ({"learning": slice(0, None)}, None),
        ({"fingerprints": slice(0, None), "learning": slice(0, None)}, None),
    ],
)
def test_what_rounding_explains_on_another_processor(changes, parted, monkeypatch):
    monkeypatch.setattr(whole, "by_kernels", lambda *_: False)
    found = compared(**changes)
    assert found.parted == ({} if parted is None else {7: parted})
    assert list(found.wrong) == ([7] if parted is None else [])
    assert list(compared(processor="this one", **changes).wrong) == [7]


@pytest.mark.parametrize("machine", [None, "a text", {}, {"processor": None}])
def test_a_provenance_that_names_no_processor_excuses_nothing(machine, monkeypatch):
    monkeypatch.setattr(whole, "by_kernels", lambda *_: False)
    assert list(compared({"is": machine}, learning=slice(50, None)).wrong) == [7]


def test_the_widest_kernels_excuse_nothing_on_any_processor(monkeypatch):
    note, here = {"machine": {"processor": "this one"}}, {"processor": "another"}
    for level in ("x86_64_v4", "baseline"):
        monkeypatch.setattr(native, "level", lambda level=level: level)
        assert bool(compared(learning=slice(50, None)).wrong) == (level == "x86_64_v4")
        # a Gaussian begins with a factorisation by LAPACK
        assert whole._rounds_otherwise(ROOMS, "GVT", note, here)
        assert whole._rounds_otherwise(ROOMS.pool, "sources", note, here)
        assert whole._rounds_otherwise(ROOMS, "NT", note, {**here, "device": "a card"})
        assert not whole._rounds_otherwise(ROOMS, "tasks", note, here)
        found = whole._rounds_otherwise(ROOMS, "1-MGVT", note, here)
        assert found == (level == "baseline")


def test_parted_sources_must_earn_what_is_stored_of_their_weights(
    tiny, stored, rewrite, monkeypatch
):
    """Solved otherwise they may be, but not with weights that do not earn it."""
    real = sources.solve

    def otherwise(*arguments):
        found = real(*arguments)
        return {**found, "weights": found["weights"] + 1, "greedy": found["greedy"] - 1}

    monkeypatch.setattr(sources, "solve", otherwise)
    pool = tiny.pool
    assert list(check_runs(pool, "sources", EVERY, stored).wrong) == EVERY
    elsewhere(monkeypatch)
    assert check_runs(pool, "sources", EVERY, stored).parted == dict.fromkeys(EVERY, 199)
    rewrite("tiny-pool/sources", fresh=store.read(stored / "tiny-pool/sources")[0]["fresh"] + EVERY)
    found = check_runs(pool, "sources", EVERY, stored)
    assert (list(found.parted), list(found.wrong)) == ([0], [1, 2])


def test_runs_of_the_engine_are_computed_in_the_batches_of_the_store(tiny, monkeypatch):
    asked = []

    def compute(unit, given):
        asked.append(list(unit.members))
        curve = np.zeros((len(unit.members), 1))
        return {"run": np.array(unit.members), "learning": curve, "iterations": np.ones(1)}, {}

    monkeypatch.setattr(whole, "compute", compute)
    for label, batches in (("DDQN", [[0, 1], [2]]), ("GVT", [[1, 2]])):
        found = whole._computed(tiny, label, [1, 2], None)
        assert asked == batches
        assert found["run"].tolist() == [1, 2]
        assert len(found["iterations"]) == 1
        asked.clear()
    assert not whole.by_kernels(evolve(tiny, visits=True), "GVT")
