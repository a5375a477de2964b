"""Mellowmax, TD errors and their psi-mixed gradients, against definitions and autograd."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from vtlib import td
from vtlib.qfunctions import MLP, QFunction, RBFLinear
from vtlib.replay import Transition
from vtlib.td import exp_of_differences, mellowmax, td_cotangent, td_error, td_gradients

KAPPAS = st.floats(1e-3, 1e3)
NUMBERS = st.floats(-1e3, 1e3)
PAIRS = st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=8)
PROPERTY = settings(deadline=None, derandomize=True)
ROUNDING = 1e-9  # of float64 at values up to 1e3, with the division by kappa >= 1e-3


def tensor(values: list[float]) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


@PROPERTY
@given(PAIRS, KAPPAS, st.floats(1.0, 10.0))
def test_mellowmax_is_a_non_expansion_between_mean_and_maximum_that_rises(pairs, kappa, factor):
    x, y = tensor(pairs).unbind(-1)
    value = mellowmax(x, kappa)
    assert (value - mellowmax(y, kappa)).abs() <= (x - y).abs().max() + ROUNDING
    assert x.mean() - ROUNDING <= value <= x.max() + ROUNDING
    assert value >= x.max() - math.log(len(pairs)) / kappa - ROUNDING
    assert mellowmax(x, factor * kappa) >= value - ROUNDING


@pytest.mark.parametrize("kappa", [0.1, 1.0, 30.0])
def test_mellowmax_equals_its_formula(kappa):
    x = torch.randn(3, 5, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    direct = (kappa * x).exp().mean(1).log() / kappa
    torch.testing.assert_close(mellowmax(x, kappa, dim=1), direct)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("actions", [1, 2, 3, 4, 7])
def test_mellowmax_of_equal_values_is_exact(dtype, actions):
    levels = torch.tensor([0.0, 0.1, -3.3, 63.397, 1e4], dtype=dtype)
    x = levels.unsqueeze(-1).expand(-1, actions)
    for kappa in (1e-3, 1.0, 100.0):
        assert torch.equal(mellowmax(x, kappa), levels)


@pytest.mark.parametrize("kappa", [0.0, -1.0, math.nan, math.inf])
def test_mellowmax_refuses_other_kappa(kappa):
    with pytest.raises(ValueError, match="kappa must be positive"):
        mellowmax(torch.zeros(2), kappa)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@PROPERTY
@given(x=st.lists(st.floats(-1e4, 0), min_size=1, max_size=20))
def test_exponentials_are_exact_where_a_sum_with_one_feels_them(dtype, x):
    eps = torch.finfo(dtype).eps
    exact = torch.tensor(x, dtype=dtype).double().exp()
    ours = exp_of_differences(torch.tensor(x, dtype=dtype)).double()
    kept = ours > 0
    torch.testing.assert_close(ours[kept], exact[kept], rtol=4 * eps, atol=0)
    assert not exact[~kept].gt(1.01 * eps).any()
    assert not ours[kept].lt(0.99 * eps).any(), "nothing may become denormal"


def problem(spread: float = 0.1) -> dict[str, Tensor]:
    """Q-values (2, 3, A=4, B=6) in float64 with three terminal transitions in each batch."""
    g = torch.Generator().manual_seed(0)
    shape = (2, 3, 4, 6)
    return {
        "q": spread * torch.randn(shape, dtype=torch.float64, generator=g),
        "q_next": spread * torch.randn(shape, dtype=torch.float64, generator=g),
        "action": torch.randint(4, (2, 1, 6), generator=g),
        "reward": torch.randn(2, 1, 6, dtype=torch.float64, generator=g),
        "terminated": torch.tensor([True, False, False, True, False, True]).expand(2, 1, 6),
    }


def test_td_error_one_transition_at_a_time():
    p, gamma, kappa = problem(), 0.9, 5.0
    errors = td_error(**p, gamma=gamma, kappa=kappa)
    for r, k, b in torch.cartesian_prod(*map(torch.arange, (2, 3, 6))).tolist():
        value = mellowmax(p["q_next"][r, k, :, b], kappa)
        alive = 0.0 if p["terminated"][r, 0, b] else 1.0
        target = p["reward"][r, 0, b] + gamma * alive * value
        expected = target - p["q"][r, k, p["action"][r, 0, b], b]
        assert errors[r, k, b].item() == pytest.approx(expected.item(), abs=1e-12)


@pytest.mark.parametrize("spread", [0.1, 1e3])  # the mellowmax soft, and as sharp as a maximum
@pytest.mark.parametrize("psi", [0.0, 0.3, 1.0])
def test_cotangents_are_autograds_with_the_next_state_weighted_by_psi(psi, spread):
    p = problem(spread)
    before = {name: value.clone() for name, value in p.items()}
    ours = td_cotangent(**p, psi=psi, gamma=0.9, kappa=30.0)
    assert all(torch.equal(p[name], before[name]) for name in p), "arguments are left alone"
    leaves = [p[name].requires_grad_() for name in ("q", "q_next")]
    mixed = psi * p["q_next"] + (1 - psi) * p["q_next"].detach()
    error = td_error(**{**p, "q_next": mixed}, gamma=0.9, kappa=30.0)
    expected = torch.autograd.grad(error.square().mean(-1).sum(), leaves)
    for gradient, autograd in zip(ours, expected, strict=True):
        # gamma meets the flags of terminal states in float32
        torch.testing.assert_close(gradient, autograd, rtol=1e-6, atol=1e-6)


def batch_of(runs: int, size: int) -> Transition:
    g = torch.Generator().manual_seed(1)
    return Transition(
        torch.randn(runs, size, 2, generator=g),
        torch.randint(3, (runs, size), generator=g),
        torch.randn(runs, size, generator=g),
        torch.randn(runs, size, 2, generator=g),
        torch.rand(runs, size, generator=g) < 0.3,
    )


def by_autograd(q: QFunction, w: Tensor, batch: Transition, psi: float) -> Tensor:
    """The gradient (R, K, d) of eq. 5.4, for gamma 0.9 and kappa 20."""
    w = w.clone().requires_grad_()
    now, after = (q.q(w, q.prepare(x)) for x in (batch.obs, batch.next_obs))
    after = psi * after + (1 - psi) * after.detach()
    flags = (x.unsqueeze(1) for x in (batch.action, batch.reward, batch.terminated))
    error = td_error(now, after, *flags, 0.9, 20.0)
    return torch.autograd.grad(error.square().mean(-1).sum(), w)[0]


@pytest.mark.parametrize("psi", [0.0, 0.3, 1.0])
@pytest.mark.parametrize(
    "q", [RBFLinear(torch.arange(-2.0, 3.0), 1.0, 3), MLP((2, 6, 3)), MLP((2, 4, 5, 3))],
    ids=["rbf", "mlp", "deep"],
)  # fmt: skip
def test_gradients_are_autograds_however_few_are_taken_at_a_time(monkeypatch, q, psi):
    runs, k, size = 5, 4, 8
    batch = batch_of(runs, size)
    w = 0.5 * torch.randn(runs, k, q.d, generator=torch.Generator().manual_seed(4))
    expected = by_autograd(q, w, batch, psi)
    # all runs and weights at once, two runs, one run, three of its weights, one of them
    for limit in (td.CACHED, *(n * 2 * size * q.width for n in (2 * k, k, 3, 1)), 1):
        monkeypatch.setattr(td, "CACHED", limit)
        ours = td_gradients(q, w, batch, psi, 0.9, 20.0)
        torch.testing.assert_close(ours, expected, rtol=1e-3, atol=1e-5)
