"""Deliberate faults: recomputing the head of a stored run catches each of them."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from vtlib import streams, transfer
from vtlib.envs.rooms import Rooms
from vtlib.experiments import ROOMS_EVALUATION
from vtlib.experiments.verify import check_heads
from vtlib.store import results_folder

RUN = 7


def gradient_sign(monkeypatch) -> None:
    real = transfer.td_gradients
    monkeypatch.setattr(transfer, "td_gradients", lambda *arguments: -real(*arguments))


def psi_ignored(monkeypatch) -> None:
    real = transfer.td_cotangent

    def always_half_of_it(*arguments):
        *first, psi, gamma, kappa = arguments
        return real(*first, psi / 2, gamma, kappa)

    monkeypatch.setattr(transfer, "td_cotangent", always_half_of_it)


def kl_weight(monkeypatch) -> None:
    real = transfer.VariationalTransfer._kl_gradient
    monkeypatch.setattr(transfer.VariationalTransfer, "_kl_gradient", lambda self: 2 * real(self))


def shifted_seed(monkeypatch) -> None:
    real = streams.generator
    monkeypatch.setattr(streams, "generator", lambda name, run, role: real(name, run + 1, role))


def leaking_wall(monkeypatch) -> None:
    def nowhere(self: Rooms, state: torch.Tensor, proposed: torch.Tensor) -> torch.Tensor:
        return torch.zeros(len(state), 1, dtype=torch.bool)

    monkeypatch.setattr(Rooms, "_blocked", nowhere)


def differs() -> bool:
    return bool(check_heads(ROOMS_EVALUATION.name, "1-MGVT", results_folder(), [RUN]).wrong)


def test_without_a_fault_nothing_differs():
    assert not differs()


@pytest.mark.parametrize(
    "fault", [gradient_sign, psi_ignored, kl_weight, shifted_seed, leaking_wall]
)
def test_a_fault_is_caught(fault: Callable, monkeypatch):
    fault(monkeypatch)
    assert differs()
