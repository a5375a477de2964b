"""Recomputed heads against stored ones, here and elsewhere."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from attrs import evolve

from vtbook.experiments.cartpole import CARTPOLE
from vtbook.experiments.rooms import ROOMS_EVALUATION, THREE_ROOMS
from vtlib import rng, transfer
from vtlib.envs.rooms import Rooms
from vtlib.experiments import run, sources, store
from vtlib.experiments.heads import check_heads, live_check
from vtlib.native import runs
from vtlib.priors import MixturePrior

CART, ROOMS = CARTPOLE.published, ROOMS_EVALUATION.published
STORED, NOTE = store.stored(CART, "DDQN")


def rewrite(owner, label, root, **change):
    """Replace or leave out arrays of a result, as somebody would who knows its digest."""
    path = store.path_of(owner, label, root)
    arrays, note = store.read(path)
    store.remove(path)
    kept = {key: array for key, array in {**arrays, **change}.items() if array is not None}
    store.save(path, kept, note)


# --- heads ---------------------------------------------------------------------------------------


def test_heads_of_every_kind_of_result_are_verified(tiny, stored):
    for owner, label in store.results_of(tiny):
        assert check_heads(owner, label, stored) == ([], []), label
    assert check_heads(tiny, "2-MGVT", stored, [2]).wrong == []


@pytest.mark.parametrize("label", ["GVT", "sources"])
def test_a_changed_fingerprint_is_named(tiny, stored, label):
    owner = tiny.pool if label == "sources" else tiny
    prints = store.stored(owner, label, stored)[0]["fingerprints"]
    prints[1, 2, 0] += 1.0
    rewrite(owner, label, stored, fingerprints=prints)
    assert check_heads(owner, label, stored).wrong == [1]


def test_changed_tasks_are_named(tiny, stored):
    table = store.stored(tiny, "tasks", stored)[0]
    rewrite(tiny, "tasks", stored, sources=np.roll(table["sources"], 1, axis=1))
    assert check_heads(tiny, "tasks", stored).wrong
    rewrite(tiny, "tasks", stored, **{**table, "optimum": table["optimum"] + [0, 0, 1]})
    assert check_heads(tiny, "tasks", stored, [0, 1]).wrong == []
    assert check_heads(tiny, "tasks", stored, [2]).wrong == [2]


@pytest.mark.parametrize("label", ["GVT", "sources"])
def test_a_shifted_seed_does_not_verify(tiny, stored, label, monkeypatch):
    monkeypatch.setattr(store, "check_note", lambda *_: None)
    shifted = evolve(tiny, stream="other", pool=evolve(tiny.pool, stream="other"))
    owner = shifted.pool if label == "sources" else shifted
    assert check_heads(owner, label, stored).wrong == [0, 1, 2]


@pytest.mark.parametrize("key", ["fingerprints", "optimum"])
@pytest.mark.parametrize(
    "wrong", [None, np.zeros(0), np.float64(0), np.zeros((1, 3, 4)), np.full(3, "x")]
)
def test_arrays_of_another_shape_never_verify(tiny, stored, key, wrong):
    label = "GVT" if key == "fingerprints" else "tasks"
    rewrite(tiny, label, stored, **{key: wrong})
    if label == "GVT":
        with pytest.raises(store.TornResult, match="does not hold 3 fingerprints"):
            check_heads(tiny, label, stored)
    else:
        assert check_heads(tiny, label, stored).wrong == [0, 1, 2]


@pytest.mark.parametrize("member", [3, -1, 1.0, None, True])
def test_a_run_that_is_not_stored_cannot_be_verified(tiny, stored, member):
    with pytest.raises(ValueError, match="member must be a whole number from 0 to 2, got"):
        check_heads(tiny, "GVT", stored, [member])


def with_differing(
    monkeypatch, differ: set[int], processor: str, start: int = 1
) -> list[list[int]]:
    """Let some heads differ from the fingerprint ``start`` on; which runs were computed."""
    asked = []

    def head(experiment, label, runs, weights):
        asked.append(list(runs))
        prints = STORED["fingerprints"][list(runs)].copy()
        prints[[one in differ for one in runs], start:] *= 1.01
        return prints

    monkeypatch.setattr(run, "head", head)
    monkeypatch.setattr(store, "machine", lambda: {"processor": processor})
    return asked


@pytest.mark.parametrize("differ", [{3}, {3, 5}, set(range(20))])
def test_on_the_same_processor_every_run_counts(monkeypatch, differ):
    asked = with_differing(monkeypatch, differ, NOTE["machine"]["processor"])
    assert check_heads(CART, "DDQN") == (sorted(differ), [])
    assert check_heads(CART, "DDQN", members=[3, 19]) == (sorted(differ & {3, 19}), [])
    assert asked == [list(range(20)), [3, 19]]


@pytest.mark.parametrize("machine", [None, "a text", {}, {"processor": None}])
def test_a_provenance_that_names_no_processor_excuses_nothing(monkeypatch, machine):
    with_differing(monkeypatch, {3}, "of another kind")
    real = store.stored

    def unnamed(*arguments):
        arrays, note = real(*arguments)
        return arrays, {**note, "machine": machine}

    monkeypatch.setattr(store, "stored", unnamed)
    assert check_heads(CART, "DDQN") == ([3], [])


@pytest.mark.parametrize(
    ("differ", "members", "wrong", "parted"),
    [
        ({3, 5}, None, [], [3, 5]),
        (set(range(6)), None, [], list(range(6))),
        (set(range(7)), None, list(range(7)), []),
        ({3}, [3], [], [3]),
        ({3, 0, 1}, [3], [], [3]),
        ({3, 0, 1, 2}, [3], [3], []),
        (set(range(20)), [3, 4], [3, 4], []),
        ({0, 1, 2, 5}, [3, 4], [], []),
    ],
)
def test_on_another_processor_a_few_among_many_are_rounding(
    monkeypatch, differ, members, wrong, parted
):
    asked = with_differing(monkeypatch, differ, "of another kind")
    assert check_heads(CART, "DDQN", members=members) == (wrong, parted)
    looked_at = [one for runs in asked for one in runs]
    assert len(looked_at) == len(set(looked_at))
    differ = differ & set(members if members is not None else range(20))
    assert len(looked_at) == (20 if members is None else 10 if differ else len(members))


@pytest.mark.parametrize("members", [None, [3], [3, 4]])
def test_a_first_iteration_that_differs_is_no_rounding(monkeypatch, members):
    with_differing(monkeypatch, {3}, "of another kind", start=0)
    assert check_heads(CART, "DDQN", members=members) == ([3], [])
    assert "does NOT have" in live_check(CART, "DDQN", 3)
    assert live_check(CART, "DDQN", 4).endswith("has the stored fingerprints.")
    with_differing(monkeypatch, {3}, "of another kind")
    assert "has the stored fingerprints until rounding" in live_check(CART, "DDQN", 3)


# --- deliberate faults ---------------------------------------------------------------------------


def gradient_sign(monkeypatch) -> None:
    real = transfer.td_gradients
    monkeypatch.setattr(transfer, "td_gradients", lambda *arguments: -real(*arguments))


def psi_ignored(monkeypatch) -> None:
    real = transfer.td_gradients

    def half(q, weights, batch, psi, gamma, kappa):
        return real(q, weights, batch, psi / 2, gamma, kappa)

    monkeypatch.setattr(transfer, "td_gradients", half)


def kl_weight(monkeypatch) -> None:
    real = MixturePrior.pull
    monkeypatch.setattr(MixturePrior, "pull", lambda self, mu: 2 * real(self, mu))


def shifted_seed(monkeypatch) -> None:
    real = rng.generator
    monkeypatch.setattr(rng, "generator", lambda name, one, role: real(name, one + 1, role))


def leaking_wall(monkeypatch) -> None:
    def nowhere(self: Rooms, state: torch.Tensor, proposed: torch.Tensor) -> torch.Tensor:
        return torch.zeros(len(state), 1, dtype=torch.bool)

    monkeypatch.setattr(Rooms, "_blocked", nowhere)


@pytest.mark.parametrize(
    "fault",
    [lambda _: None, gradient_sign, psi_ignored, kl_weight, shifted_seed, leaking_wall],
    ids=lambda fault: fault.__name__,
)
def test_a_fault_is_caught(fault: Callable, monkeypatch):
    monkeypatch.setattr(run, "prepare_natively", lambda *_: None)
    fault(monkeypatch)
    wrong = check_heads(ROOMS, "1-MGVT", members=[7]).wrong
    assert wrong == ([] if fault.__name__ == "<lambda>" else [7])


def test_a_fault_in_the_kernels_is_caught(monkeypatch):
    assert check_heads(ROOMS, "1-MGVT", members=[7]).wrong == []
    monkeypatch.setattr(runs.NativeRun, "_numbers", shifted(runs.NativeRun._numbers))
    assert check_heads(ROOMS, "1-MGVT", members=[7]).wrong == [7]


def shifted(real: Callable) -> Callable:
    """Random numbers in another order."""
    return lambda *arguments: real(*arguments)[::-1].copy()


def test_a_fault_in_solving_sources_is_caught(monkeypatch):
    assert check_heads(THREE_ROOMS, "sources", members=[3]).wrong == []
    monkeypatch.setattr(sources, "AttemptRng", lambda name, runs, _: rng.Rng(name + "x", runs))
    assert check_heads(THREE_ROOMS, "sources", members=[3]).wrong == [3]
