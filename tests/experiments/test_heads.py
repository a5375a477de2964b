"""Recomputed heads against stored ones, here and elsewhere."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from vtbook.experiments.cartpole import CARTPOLE
from vtbook.experiments.rooms import ROOMS_EVALUATION, THREE_ROOMS
from vtlib import rng, transfer
from vtlib.envs.rooms import Rooms
from vtlib.experiments import run, sources, store
from vtlib.experiments.heads import check_heads, live_check, verify_heads
from vtlib.native.runs import NativeRun
from vtlib.priors import MixturePrior

CART, ROOMS = CARTPOLE.published, ROOMS_EVALUATION.published
STORED, NOTE = store.stored(CART, "DDQN")


def test_heads_of_every_kind_of_result_are_verified(tiny, stored):
    found = list(verify_heads(tiny, tiny, root=stored))
    assert [(owner, label) for owner, label, _ in found] == store.results_of(tiny)
    assert all(heads == ([0, 1, 2], {}, {}) for *_, heads in found)
    assert check_heads(tiny, "2-MGVT", stored, [2]) == ([2], {}, {})


def with_differing(monkeypatch, differ: set[int], processor: str, start: int = 1) -> list[int]:
    """Let some heads differ from the fingerprint ``start`` on; which runs were computed."""
    asked = []

    def head(experiment, label, runs, weights):
        asked.extend(runs)
        prints = STORED["fingerprints"][runs]
        prints[[one in differ for one in runs], start:] *= 1.01
        return prints

    monkeypatch.setattr(run, "head", head)
    monkeypatch.setattr(store, "machine", lambda: {"processor": processor})
    return asked


def test_on_the_same_processor_every_run_counts(monkeypatch):
    asked = with_differing(monkeypatch, {3, 5}, NOTE["machine"]["processor"])
    assert list(check_heads(CART, "DDQN").wrong) == [3, 5]
    assert list(check_heads(CART, "DDQN", members=[3, 19]).wrong) == [3]
    assert asked == [*range(20), 3, 19]


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
    found = check_heads(CART, "DDQN", members=members)
    assert (list(found.wrong), found.parted) == (wrong, dict.fromkeys(parted, 48))
    assert len(asked) == len(set(asked))
    differ = differ & set(range(20) if members is None else members)
    assert len(asked) == (20 if members is None else 10 if differ else len(members))


@pytest.mark.parametrize("members", [None, [3], [3, 4]])
def test_a_first_iteration_that_differs_is_no_rounding(monkeypatch, members):
    with_differing(monkeypatch, {3}, "of another kind", start=0)
    found = check_heads(CART, "DDQN", members=members)
    assert (list(found.wrong), found.parted) == ([3], {})


def test_the_live_check_says_what_was_found(monkeypatch):
    with_differing(monkeypatch, {3}, "of another kind", start=0)
    assert "does NOT have" in live_check(CART, "DDQN", 3)
    assert live_check(CART, "DDQN", 4).endswith("has the stored fingerprints.")
    with_differing(monkeypatch, {3}, "of another kind")
    assert "has the stored fingerprints until rounding" in live_check(CART, "DDQN", 3)


# --- deliberate faults ---------------------------------------------------------------------------


def no_fault(monkeypatch) -> None:
    """The engine leaves what the kernels have left."""


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
    def nowhere(self: Rooms, state: Tensor, proposed: Tensor) -> Tensor:
        return torch.zeros(len(state), 1, dtype=torch.bool)

    monkeypatch.setattr(Rooms, "_blocked", nowhere)


@pytest.mark.parametrize(
    "fault", [no_fault, gradient_sign, psi_ignored, kl_weight, shifted_seed, leaking_wall]
)
def test_a_fault_is_caught(fault: Callable, monkeypatch):
    monkeypatch.setattr(run, "prepare_natively", lambda *_: None)
    fault(monkeypatch)
    wrong = check_heads(ROOMS, "1-MGVT", members=[7]).wrong
    assert list(wrong) == ([] if fault is no_fault else [7])


def test_a_fault_in_the_kernels_is_caught(monkeypatch):
    assert not check_heads(ROOMS, "1-MGVT", members=[7]).wrong
    real = NativeRun._numbers  # random numbers in another order
    monkeypatch.setattr(NativeRun, "_numbers", lambda *given: real(*given)[::-1].copy())
    assert list(check_heads(ROOMS, "1-MGVT", members=[7]).wrong) == [7]


def test_a_fault_in_solving_sources_is_caught(monkeypatch):
    assert not check_heads(THREE_ROOMS, "sources", members=[3]).wrong
    monkeypatch.setattr(sources, "AttemptRng", lambda name, runs, _: rng.Rng(name + "x", runs))
    assert list(check_heads(THREE_ROOMS, "sources", members=[3]).wrong) == [3]
