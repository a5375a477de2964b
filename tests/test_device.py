"""Posteriors on another device: tried without one, on a processor that plays its part.

Tensors that would lie on the device are marked, and what PyTorch refuses is refused: operations
on tensors of both sides, and NumPy's view of a tensor on the device.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode

from vtlib import factor_deferred, store
from vtlib.experiments import CARTPOLE, CARTPOLE_LATE, ROOMS_CALIBRATION, ROOMS_EVALUATION, work
from vtlib.experiments import runs as runs_of
from vtlib.experiments.experiment import Experiment
from vtlib.factor_deferred import AHEAD, DeferredFactors
from vtlib.gaussian import Precision
from vtlib.transfer import LARGE

CARD = torch.device("cuda", 0)


class Marked(Tensor):
    """A tensor that would lie on the card."""


class PretendedCard(TorchFunctionMode):
    """PyTorch with a card that is none."""

    def __torch_function__(
        self, func: Any, types: Any, args: tuple[Any, ...] = (), kwargs: Any = None
    ) -> Any:
        kwargs = dict(kwargs or {})
        if func == Tensor.device.__get__ and isinstance(args[0], Marked):
            return CARD
        if func is Tensor.cpu:
            return args[0].as_subclass(Tensor)
        if func is Tensor.numpy and isinstance(args[0], Marked):
            raise TypeError("a tensor on the card has no numpy array")
        if func is Tensor.to and _means_card(args[1]):
            return args[0].as_subclass(Marked)
        if "device" in kwargs and _means_card(kwargs["device"]):
            made: Tensor = func(*args, **{**kwargs, "device": "cpu"})
            return made.as_subclass(Marked)
        # PyTorch takes numbers and indices of the processor on the card
        free = func in (Tensor.__getitem__, Tensor.__setitem__)
        sides = {isinstance(t, Marked) for t in _tensors((args, kwargs)) if t.dim() or free}
        if len(sides) == 2 and not (free and isinstance(args[0], Marked)):
            raise RuntimeError(f"{func} was given tensors of the card and of the processor")
        return func(*args, **kwargs)


def _means_card(device: object) -> bool:
    return isinstance(device, str | torch.device) and torch.device(device) in (
        CARD,
        torch.device("cuda"),
    )


def _tensors(values: Any) -> Iterator[Tensor]:
    if isinstance(values, Tensor):
        yield values
    elif isinstance(values, dict):
        yield from _tensors(tuple(values.values()))
    elif isinstance(values, list | tuple):
        for value in values:
            yield from _tensors(value)


def both(experiment: Experiment, label: str) -> tuple[store.Arrays, store.Arrays]:
    """The arrays of two short runs, on the processor and on the pretended card."""
    pool = work.pool_weights(experiment.pool, store.results_folder())
    short = replace(experiment, iterations=40, every=20, runs=2)
    here = runs_of.run_batch(short, label, [0, 1], pool)
    with PretendedCard():
        there = runs_of.run_batch(short, label, [0, 1], pool, device="cuda")
    return here, there


@pytest.mark.parametrize(
    ("experiment", "label"),
    [
        (ROOMS_EVALUATION, "GVT"),
        (ROOMS_EVALUATION, "3-MGVT"),
        (ROOMS_EVALUATION, "NT"),
        (ROOMS_CALIBRATION, "3-MGVT"),
        (CARTPOLE, "GVT"),
        (CARTPOLE, "3-MGVT"),
        (CARTPOLE, "DDQN"),
        (CARTPOLE_LATE, "1-MGVT, full gradient"),
    ],
)
def test_runs_on_a_card_mix_nothing_and_are_the_same(experiment, label):
    here, there = both(experiment, label)
    assert here.keys() == there.keys()
    for key in here:
        np.testing.assert_array_equal(here[key], there[key])


@pytest.mark.parametrize("act", ["step", "episode"])
@pytest.mark.parametrize("covariance", ["full", "diagonal"])
@pytest.mark.parametrize("family", ["gaussian", "mixture"])
def test_large_posteriors_on_a_card(monkeypatch, act, covariance, family):
    assert LARGE > 100
    monkeypatch.setattr("vtlib.transfer.LARGE", 100)
    monkeypatch.setattr(factor_deferred, "PANEL", 32)
    settings = replace(
        CARTPOLE.transfer_settings("GVT" if family == "gaussian" else "3-MGVT"),
        act=act,
        covariance=covariance,
    )
    here, there = both(replace(CARTPOLE, algorithms={"one": settings}), "one")
    for key in here:
        np.testing.assert_array_equal(here[key], there[key])


def clipped(device: str, rows: Sequence[int]) -> Tensor:
    """L after some steps that clipping binds in some rows, with a precision of low rank."""
    g = torch.Generator().manual_seed(3)
    d, noise = 150, torch.randn(AHEAD, 2, 4, 150, generator=g)
    gradients = torch.randn(AHEAD, 2, 3, d, generator=g)
    gradients[2:, 0, :, rows] *= 1e4
    L, W = torch.eye(d).repeat(2, 1, 1), 0.1 * torch.randn(2, d, 2, generator=g)
    L, W, noise, gradients = (x.to(device) for x in (L, W, noise, gradients))
    factors = DeferredFactors(L, Precision(5.0, W), 1e-3, 0.1, 100.0)
    factors.look_ahead(noise)
    for t in range(AHEAD):
        factors.product(t)
        factors.step(gradients[t], noise[t, :, 1:], 0.1)
    return factors.L.cpu()


@pytest.mark.parametrize("rows", [[0, 70, 149], range(0, 150, 2)], ids=["few", "many"])
def test_clipped_steps_on_a_card(rows):
    here = clipped("cpu", rows)
    with PretendedCard():
        there = clipped("cuda", rows)
    assert torch.equal(here, there)


def test_the_pretended_card_refuses_what_a_card_refuses():
    with PretendedCard():
        there, here = torch.ones(2, device="cuda"), torch.ones(2)
        assert there.device == CARD
        assert (2 * there + here.to(CARD)).device == CARD
        assert here[torch.arange(1)].device.type == there.cpu().device.type == "cpu"
        for refused in (
            lambda: there + here,
            lambda: torch.cat([there, here]),
            lambda: here[torch.zeros(1, dtype=torch.int64, device=CARD)],
        ):
            with pytest.raises(RuntimeError, match="of the card and of the processor"):
                refused()
        with pytest.raises(TypeError, match="no numpy array"):
            there.numpy()


def test_the_provenance_of_a_result_names_the_card(monkeypatch):
    assert "device" not in store.machine()
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda device: f"a card called {device}")
    assert store.machine("cuda:1")["device"] == "a card called cuda:1"
