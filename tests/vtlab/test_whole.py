"""Whole runs computed anew: every number that could be forged, and faults that show late."""

import numpy as np
import pytest
from attrs import evolve

from vtbook.experiments.maze import MAIN, MAZE_TARGETS
from vtbook.experiments.rooms import ROOMS_EVALUATION
from vtlab import run, sources, store, whole
from vtlab.heads import check_heads
from vtlab.whole import Whole, check_runs, verify
from vtlib import baselines, native

EVERY, ROOMS = [0, 1, 2], ROOMS_EVALUATION.published
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
    """Every result computed anew, once for all tests of what is stored."""
    given = store.weights(tiny.pool, computed)
    return {label: whole._computed(o, label, EVERY, given) for o, label in store.results_of(tiny)}


@pytest.fixture
def checked(tiny, stored, rewrite, anew, monkeypatch):
    """What is wrong in all that is stored of a result, and in its heads, after some changes."""
    monkeypatch.setattr(whole, "_computed", lambda _, label, *__: anew[label])

    def check(label, **changes):
        owner = tiny.pool if label == "sources" else tiny
        rewrite(f"{owner.name}/{label}", **changes)
        found = check_runs(owner, label, root=stored)
        assert not found.parted
        return found.wrong, check_heads(owner, label, stored).wrong

    return check


def test_one_member_of_each_result_is_drawn(tiny, monkeypatch):
    monkeypatch.setattr(whole, "check_runs", lambda *given: given[2])
    drawn = [members for *_, members in verify(tiny, rng=np.random.default_rng(3))]
    assert {len(one) for one in drawn} == {1}
    assert len({*map(tuple, drawn)}) > 1


@pytest.mark.parametrize(
    ("name", "key"), [(name, key) for name, keys in KINDS.items() for key in keys.split()]
)
def test_a_forged_number_is_named(stored, checked, name, key):
    label, forged = name.split("/")[1], store.read(stored / name)[0][key]
    shared = (label, key) == ("GVT", "iterations")
    last = (forged if shared else forged[1:2]).reshape(-1)[-1:]
    last += np.asarray(1 if last.dtype.kind in "ib" else 0.1, last.dtype)
    wrong, of_heads = checked(label, **{key: forged})
    assert list(wrong) == (EVERY if shared else [1])
    assert wrong[1].startswith(key)
    assert " is " in wrong[1]
    assert list(of_heads) == ([1] if label == "tasks" or key == "fingerprints" else [])


@pytest.mark.parametrize(("key", "shape"), [("visited", (220, 4)), ("inside", (11, 5, 3))])
def test_a_forged_visit_or_probe_is_named(tiny, stored, anew, key, shape):
    arrays, note = store.read(stored / "tiny/GVT")
    more = np.random.default_rng(0).random((3, *shape), np.float32)
    forged = more.copy()
    forged[1].flat[-1] += 0.1
    there, now = {**arrays, key: forged}, {**anew["GVT"], key: more}
    found = whole.compare_runs(tiny, "GVT", (there, note), now, EVERY)
    assert list(found.wrong) == [1]
    assert found.wrong[1].startswith(key)


def test_another_evaluation_is_named(tiny, stored, monkeypatch):
    monkeypatch.setattr(run, "EVALUATION_EPISODES", 11)
    for label in ("GVT", "DDQN"):
        assert check_runs(tiny, label, [0], stored).wrong[0].startswith("greedy")


def test_results_in_place_of_others_and_runs_left_out_are_named(stored, checked):
    others = store.read(stored / "tiny/DDQN")[0]
    assert [list(found) for found in checked("GVT", **others)] == [EVERY, EVERY]
    fewer = {key: x if key == "iterations" else x[[0, 2]] for key, x in others.items()}
    assert [list(found) for found in checked("DDQN", **fewer)] == [EVERY, EVERY]


@pytest.mark.parametrize(
    ("key", "wrong", "said"),
    [
        ("fingerprints", None, "missing, anew there"),
        ("fingerprint", np.zeros(3), "there, anew missing"),
        ("fingerprints", np.zeros(0), "float64(0,), anew float"),
        ("fingerprints", np.array(0.0), "float64(), anew float"),
        ("fingerprints", np.zeros((1, 3, 4)), "float64(1, 3, 4), anew float"),
        ("fingerprints", np.array(["x"] * 3), "<U1(3,), anew float"),
    ],
)
def test_arrays_that_lack_or_have_another_shape_are_named(checked, key, wrong, said):
    found, of_heads = checked("GVT", **{key: wrong})
    assert list(found) == EVERY
    assert all(what.startswith(f"{key} is {said}") for what in found.values())
    assert list(of_heads) == ([] if key == "fingerprint" else EVERY)


@pytest.mark.parametrize("forged", [False, True])
def test_runs_that_rounding_has_parted_have_to_earn_what_others_do(monkeypatch, forged):
    runs, arrays = range(20), store.stored(ROOMS, "NT")[0]
    anew = {k: v.copy() for k, v in arrays.items()}
    for key in whole.EARNED:  # in another order, as if by chance, or more at the end
        anew[key][:, 99:] = anew[key][::-1, 99:] + np.linspace(1, 2, 20)[:, None]
        arrays[key] = anew[key][::-1].copy() if not forged else arrays[key]
    monkeypatch.setattr(store, "stored", lambda *_: (arrays, {}))
    monkeypatch.setattr(store, "weights", lambda *_: None)
    monkeypatch.setattr(whole, "_computed", lambda *_: anew)
    monkeypatch.setattr(whole, "compare_runs", lambda *_: Whole([], dict.fromkeys(runs, 9), {}))
    monkeypatch.setattr(whole, "DRAWS", 50_000)
    assert list(check_runs(ROOMS, "NT").wrong) == ([*runs] if forged else [])


def test_a_fault_that_shows_late_is_named(tiny, stored, monkeypatch):
    calls, real = iter(range(10**6)), baselines.DDQN.learn

    def late(self, transition):
        real(self, transition)
        if next(calls) == 205:
            self.mu = -self.mu

    monkeypatch.setattr(baselines.DDQN, "learn", late)
    assert not check_heads(tiny, "DDQN", stored).wrong
    calls = iter(range(10**6))
    assert "at iteration 220" in check_runs(tiny, "DDQN", [0], stored).wrong[0]


@pytest.mark.parametrize("member", [3, -1, 1.0, None, True])
def test_members_that_are_not_there_are_refused(tiny, computed, member):
    for check, *given in ((check_runs, [member], computed), (check_heads, computed, [member])):
        with pytest.raises(ValueError, match="member must be a whole number from 0 to 2, got"):
            check(tiny, "GVT", *given)


def compared(machine="this one", processor="another", reward=1, **changes) -> Whole:
    """A stored result of the rooms, and one run of it anew, which changes say to be otherwise."""
    arrays = store.stored(ROOMS, "NT")[0] | {"visited": np.zeros((20, ROOMS.iterations, 2))}
    rising = np.linspace(0, reward, len(arrays["iterations"]))
    arrays["learning"] = arrays["learning"] + rising  # none of its own in run 7
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
        ({"greedy": [0]}, 99),
        ({"greedy": [0], "learning": slice(50, None)}, 99),
        ({"visited": slice(-60, None)}, 19_940),
        ({"fingerprints": slice(1, None), "learning": slice(0, None)}, 48),
        ({"fingerprints": slice(1, None), "greedy": slice(40, None), "reward": 0}, 48),
        ({"greedy": slice(40, None), "reward": 0}, 4_099),
        ({"greedy": slice(0, None), "reward": 0}, None),
        # for another reason
        ({"greedy": [3, 4, 9]}, None),
        ({"fingerprints": slice(1, None), "greedy": slice(40, None)}, None),
        ({"visited": slice(-600, None)}, None),
        ({"learning": [30]}, None),
        ({"learning": slice(0, None)}, None),
        ({"fingerprints": slice(0, None), "learning": slice(0, None)}, None),
    ],
)
def test_what_rounding_explains_on_another_processor(changes, parted, monkeypatch):
    monkeypatch.setattr(whole, "by_kernels", lambda *_: False)
    monkeypatch.setattr(native, "level", lambda: "x86_64_v4")
    found = compared(**changes)
    assert found.parted == ({} if parted is None else {7: parted})
    assert list(found.wrong) == ([7] if parted is None else [])
    assert list(compared(processor="this one", **changes).wrong) == [7]


@pytest.mark.parametrize("machine", [None, "a text", {}, {"processor": None}])
def test_a_provenance_that_names_no_processor_excuses_nothing(machine, monkeypatch):
    monkeypatch.setattr(whole, "by_kernels", lambda *_: False)
    assert list(compared({"is": machine}, learning=slice(50, None)).wrong) == [7]


def test_the_wider_kernels_excuse_nothing_on_any_processor(monkeypatch):
    note, here = {"machine": {"processor": "this one"}}, {"processor": "another"}
    for level in ("x86_64_v4", "x86_64_v3", "baseline"):
        monkeypatch.setattr(native, "level", lambda level=level: level)
        assert bool(compared(learning=slice(50, None)).wrong) == (level != "baseline")
        # a Gaussian begins with a factorisation by LAPACK
        assert whole._rounds_otherwise(ROOMS, "GVT", note, here)
        assert whole._rounds_otherwise(ROOMS.pool, "sources", note, here)
        assert whole._rounds_otherwise(ROOMS, "NT", note, {**here, "device": "a card"})
        assert not whole._rounds_otherwise(ROOMS, "tasks", note, here)
        found = whole._rounds_otherwise(ROOMS, "1-MGVT", note, here)
        assert found == (level == "baseline")


def test_a_tie_in_what_torch_evaluates_excuses_nothing_that_kernels_learn(monkeypatch):
    monkeypatch.setattr(native, "level", lambda: "x86_64_v4")
    assert compared(greedy=[3]).parted == {7: 399}
    for more in ({}, {"learning": slice(50, None)}, {"fingerprints": slice(1, None)}):
        places = [3] if more else [3, 4, 9]
        assert list(compared(greedy=places, **more).wrong) == [7]
    for known in ({"processor": "this one"}, {"machine": {"is": None}}):
        assert list(compared(greedy=[3], **known).wrong) == [7]


def test_where_no_kernels_are_compiled_torch_rounds_otherwise_on_the_same_processor(monkeypatch):
    monkeypatch.setattr(native, "level", lambda: None)
    monkeypatch.setattr(whole, "by_kernels", lambda *_: False)
    assert compared(processor="this one", learning=slice(50, None)).parted == {7: 5_099}
    assert list(compared(processor="this one", learning=[30]).wrong) == [7]
    here = {"processor": "this one"}
    assert whole._rounds_otherwise(ROOMS, "GVT", {"machine": here}, here)
    # what was torch's is torch's again
    card = {**here, "device": "a card"}
    assert not whole._rounds_otherwise(ROOMS, "GVT", {"machine": card}, card)
    for owner in (ROOMS.pool, evolve(ROOMS, visits=True), MAZE_TARGETS[MAIN].published):
        assert not whole._rounds_otherwise(owner, "GVT", {"machine": here}, here)


def test_parted_sources_must_earn_what_is_stored_of_their_weights(
    tiny, stored, rewrite, monkeypatch
):
    """Solved otherwise they may be, but not with weights that do not earn it."""
    pool, arrays = tiny.pool, store.read(stored / "tiny-pool/sources")[0]

    def otherwise(_, members, *__):
        found = {key: array[list(members)] for key, array in arrays.items()}
        return {**found, "weights": found["weights"] + 1, "greedy": found["greedy"] - 1}

    monkeypatch.setattr(sources, "solve", otherwise)
    assert list(check_runs(pool, "sources", EVERY, stored).wrong) == EVERY
    monkeypatch.setattr(store, "machine", lambda *_: {"processor": "another"})
    assert check_runs(pool, "sources", EVERY, stored).parted == dict.fromkeys(EVERY, 199)
    rewrite("tiny-pool/sources", fresh=arrays["fresh"] + EVERY)
    found = check_runs(pool, "sources", EVERY, stored)
    assert (list(found.parted), list(found.wrong)) == ([0], [1, 2])
    # an episode of a check may end otherwise with the same weights, but not all
    monkeypatch.setattr(sources, "solve", lambda *_: arrays)
    for share, explained in ((0.9, EVERY), (1.1, [])):
        rewrite(
            "tiny-pool/sources", **arrays | {"greedy": arrays["greedy"] + share * arrays["optimum"]}
        )
        assert list(check_runs(pool, "sources", EVERY, stored).parted) == explained


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
    # as they are where visits are asked for
    assert not whole.by_kernels(evolve(tiny, visits=True), "GVT")
