"""Whole runs computed anew: every number that could be forged, and faults that show late."""

from __future__ import annotations

import numpy as np
import pytest
from attrs import evolve

from vtbook.experiments.cartpole import CARTPOLES
from vtbook.experiments.rooms import ROOMS_EVALUATION
from vtlib import native, transfer
from vtlib.experiments import run, schedule, sources, store, whole
from vtlib.experiments.heads import check_heads
from vtlib.experiments.whole import Whole, check_runs, verify

EVERY = [0, 1, 2]
KINDS = {
    "GVT": ("fingerprints", "greedy", "iterations", "learning", "run"),
    "DDQN": ("fingerprints", "greedy", "learning"),
    "tasks": ("pole_mass", "optimum", "sources"),
    "sources": (
        "fingerprints",
        "fresh",
        "greedy",
        "index",
        "iterations",
        "pole_mass",
        "optimum",
        "passes",
        "solved",
        "weights",
    ),
}


def rewrite(owner, label, root, change) -> None:
    """Store a result otherwise, with its digest renewed."""
    path = store.path_of(owner, label, root)
    arrays, note = store.read(path)
    change(arrays, note)
    store.remove(path)
    store.save(path, arrays, note)


def owner_of(tiny, label):
    return tiny.pool if label == "sources" else tiny


def elsewhere(monkeypatch) -> None:
    """Let this be a processor of another kind, whose kernels are not the widest."""
    monkeypatch.setattr(store, "machine", lambda *_: {"processor": "another"})
    monkeypatch.setattr(native, "level", lambda: "baseline")


def test_every_result_is_what_is_stored(tiny, stored):
    found = {f"{o.name}/{label}": x for o, label, x in verify(tiny, tiny, root=stored)}
    assert list(found) == [
        "tiny-pool/sources",
        "tiny/tasks",
        *(f"tiny/{x}" for x in tiny.algorithms),
    ]
    assert all(x == Whole(EVERY, {}, {}) for x in found.values())


def test_of_every_result_one_member_is_drawn(tiny, stored):
    found = [x for *_, x in verify(tiny, root=stored, rng=np.random.default_rng(3))]
    drawn = [x.alike for x in found]
    assert all(len(one) == 1 for one in drawn)
    assert len({tuple(one) for one in drawn}) > 1


@pytest.mark.parametrize(("label", "key"), [(x, key) for x, keys in KINDS.items() for key in keys])
def test_a_forged_number_is_named(tiny, stored, label, key):
    owner = owner_of(tiny, label)

    def forge(arrays, note):
        shared = key == "iterations" and label == "GVT"
        row = arrays[key] if shared else arrays[key][1:2]
        last = row.reshape(-1)[-1:]
        last += np.asarray(1 if last.dtype.kind in "ib" else 0.1, last.dtype)

    rewrite(owner, label, stored, forge)
    found = check_runs(owner, label, EVERY, stored)
    assert list(found.wrong) == (EVERY if (label, key) == ("GVT", "iterations") else [1])
    assert found.wrong[1].startswith(key)
    assert " is " in found.wrong[1]


@pytest.mark.parametrize("key", ["learning", "greedy"])
@pytest.mark.parametrize("label", ["GVT", "DDQN"])
def test_a_forged_curve_is_named_on_another_processor_too(tiny, stored, label, key, monkeypatch):
    rewrite(tiny, label, stored, lambda arrays, _: arrays[key].fill(0.95))
    elsewhere(monkeypatch)
    found = check_runs(tiny, label, EVERY, stored)
    assert list(found.wrong) == EVERY
    assert not found.parted
    assert found.wrong[0].startswith(f"{key} at iteration 20 is 0.95")


def test_a_result_in_place_of_another_is_named(tiny, stored):
    other, _ = store.read(stored / "tiny/2-MGVT")

    def swap(arrays, note):
        arrays.update(other)

    rewrite(tiny, "GVT", stored, swap)
    assert list(check_runs(tiny, "GVT", EVERY, stored).wrong) == EVERY


def test_a_run_left_out_is_named(tiny, stored):
    def leave_out(arrays, note):
        for key in arrays.keys() - {"iterations"}:
            arrays[key] = arrays[key][[0, 2]]

    rewrite(tiny, "GVT", stored, leave_out)
    found = check_runs(tiny, "GVT", [0], stored)
    assert found.wrong == {0: "fingerprints is of 2 members, anew of 3"}


def test_an_array_left_out_or_added_is_named(tiny, stored):
    def rename(arrays, note):
        arrays["greedy one"] = arrays.pop("greedy")

    rewrite(tiny, "GVT", stored, rename)
    assert check_runs(tiny, "GVT", [2], stored).wrong == {2: "greedy is missing, anew there"}


def test_a_fault_that_shows_late_is_named(tiny, stored, monkeypatch):
    calls, real = iter(range(10**6)), transfer.td_gradients

    def late(*arguments):
        return real(*arguments) * (-1 if next(calls) >= 205 else 1)

    monkeypatch.setattr(transfer, "td_gradients", late)
    monkeypatch.setattr(run, "prepare_natively", lambda *_: None)
    assert check_heads(tiny, "GVT", stored) == ([], [])
    calls = iter(range(10**6))
    found = check_runs(tiny, "GVT", EVERY, stored)
    assert found.wrong
    assert all("at iteration 220" in what for what in found.wrong.values())


def test_another_evaluation_is_named(tiny, stored, monkeypatch):
    monkeypatch.setattr(run, "EVALUATION_EPISODES", 11)
    for label in ("GVT", "DDQN"):
        wrong = check_runs(tiny, label, EVERY, stored).wrong
        assert wrong
        assert all(what.startswith("greedy") for what in wrong.values())


@pytest.mark.parametrize("member", [3, -1, 1.0, None, True])
def test_members_that_are_not_there_are_refused(tiny, stored, member):
    with pytest.raises(ValueError, match="member must be a whole number from 0 to 2, got"):
        check_runs(tiny, "GVT", [member], stored)


# --- what rounding may do ------------------------------------------------------------------------


def made_up(**changes) -> tuple[store.Arrays, store.Arrays]:
    """A stored result of the rooms, and one run of it anew, which changes say to be otherwise."""
    arrays, _ = store.stored(ROOMS_EVALUATION.published, "NT")
    anew = {k: v if k == "iterations" else v[[7]].copy() for k, v in arrays.items()}
    for key, places in changes.items():
        anew[key][0][places] += 0.1
    return arrays, anew


def compared(arrays, anew, processor="another") -> Whole:
    note = {"machine": {"processor": "this one"}}
    experiment = ROOMS_EVALUATION.published
    return whole.compare_runs(experiment, "NT", (arrays, note), anew, [7], {"processor": processor})


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
    found = compared(*made_up(**changes))
    assert found.parted == ({} if parted is None else {7: parted})
    assert list(found.wrong) == ([7] if parted is None else [])
    assert list(compared(*made_up(**changes), "this one").wrong) == [7]


def test_the_widest_kernels_excuse_nothing_on_any_processor(monkeypatch):
    for level in ("x86_64_v4", "baseline"):
        monkeypatch.setattr(native, "level", lambda level=level: level)
        found = compared(*made_up(learning=slice(50, None)))
        assert bool(found.wrong) == (level == "x86_64_v4")
    monkeypatch.undo()
    rooms = ROOMS_EVALUATION.published
    exact = {label: whole._rounds_alike(rooms, label) for label in ("NT", "1-MGVT", "GVT", "tasks")}
    assert exact["NT"] == exact["1-MGVT"]
    # a Gaussian begins with a factorisation by LAPACK
    assert not exact["GVT"]
    assert not exact["tasks"]


def test_parted_sources_must_earn_what_is_stored_of_their_weights(tiny, stored, monkeypatch):
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

    def forge(arrays, note):
        arrays["fresh"][1] += 1

    rewrite(pool, "sources", stored, forge)
    found = check_runs(pool, "sources", EVERY, stored)
    assert (list(found.parted), list(found.wrong)) == ([0, 2], [1])


def test_runs_of_the_engine_are_computed_in_the_batches_of_the_store(tiny, monkeypatch):
    asked = []

    def compute(unit, given):
        asked.append(list(unit.members))
        return {
            "run": np.array(unit.members),
            "learning": np.zeros((len(unit.members), 1)),
            "iterations": np.ones(1),
        }, {}

    monkeypatch.setattr(whole, "compute", compute)
    for label, batches in (("DDQN", [[0, 1], [2]]), ("GVT", [[1, 2]])):
        found = whole._computed(tiny, label, [1, 2], None)
        assert asked == batches
        assert found["run"].tolist() == [1, 2]
        asked.clear()
    assert schedule.BATCH == 2
    assert not whole.by_kernels(evolve(tiny, visits=True), "GVT")
    assert CARTPOLES.count == whole.count_of(CARTPOLES)
