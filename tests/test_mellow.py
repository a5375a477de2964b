"""Mellowmax and the psi-gradient of the squared TD error, against their definitions."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from vtlib.mellow import check_psi, mellowmax, td_cotangent, td_error

KAPPAS = st.floats(1e-3, 1e3)
NUMBERS = st.floats(-1e3, 1e3)
PAIRS = st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=8)
PROPERTY = settings(deadline=None, derandomize=True)
ROUNDING = 1e-9  # of float64 at values up to 1e3, with the division by kappa >= 1e-3


def tensor(values: list[float]) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


@PROPERTY
@given(PAIRS, KAPPAS)
def test_mellowmax_is_a_non_expansion(pairs, kappa):
    x, y = tensor(pairs).unbind(-1)
    apart = (mellowmax(x, kappa) - mellowmax(y, kappa)).abs()
    assert apart <= (x - y).abs().max() + ROUNDING


@PROPERTY
@given(st.lists(NUMBERS, min_size=1, max_size=8), KAPPAS)
def test_mellowmax_lies_between_mean_and_maximum(values, kappa):
    x = tensor(values)
    value = mellowmax(x, kappa)
    assert x.mean() - ROUNDING <= value <= x.max() + ROUNDING
    assert value >= x.max() - math.log(len(values)) / kappa - ROUNDING


@PROPERTY
@given(st.lists(NUMBERS, min_size=1, max_size=8), st.floats(1e-3, 10.0), st.floats(1.0, 10.0))
def test_mellowmax_rises_with_kappa(values, kappa, factor):
    x = tensor(values)
    assert mellowmax(x, factor * kappa) >= mellowmax(x, kappa) - ROUNDING


def test_mellowmax_equals_its_formula():
    x = torch.randn(3, 5, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    for kappa in (0.1, 1.0, 30.0):
        direct = (kappa * x).exp().mean(1).log() / kappa
        torch.testing.assert_close(mellowmax(x, kappa, dim=1), direct)


def test_mellowmax_limits_in_kappa():
    x = tensor([0.3, -1.0, 2.0, 1.9])
    # the first-order term is kappa / 2 times the variance
    assert mellowmax(x, 1e-6) == pytest.approx(x.mean().item(), abs=1e-5)
    assert mellowmax(x, 1e6) == pytest.approx(x.max().item(), abs=1e-5)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("actions", [1, 2, 3, 4, 7])
def test_mellowmax_of_equal_values_is_exact(dtype, actions):
    levels = torch.tensor([0.0, 0.1, -3.3, 63.397, 1e4], dtype=dtype)
    x = levels.unsqueeze(-1).expand(-1, actions)
    for kappa in (1e-3, 1.0, 100.0):
        assert torch.equal(mellowmax(x, kappa), levels)


def test_mellowmax_does_not_overflow():
    value = mellowmax(torch.tensor([1e5, -1e5]), 100.0)
    assert value.item() == pytest.approx(1e5 - math.log(2) / 100, abs=0.01)


@pytest.mark.parametrize("kappa", [0.0, -1.0, math.nan, math.inf])
def test_mellowmax_refuses_other_kappa(kappa):
    with pytest.raises(ValueError, match="kappa must be"):
        mellowmax(torch.zeros(2), kappa)


def problem(seed: int = 0, kappa_spread: float = 0.1) -> dict[str, Tensor]:
    """Q-values (2, 3, A=4, B=6) in float64 with three terminal transitions in each batch."""
    g = torch.Generator().manual_seed(seed)
    shape = (2, 3, 4, 6)
    return {
        "q": kappa_spread * torch.randn(shape, dtype=torch.float64, generator=g),
        "q_next": kappa_spread * torch.randn(shape, dtype=torch.float64, generator=g),
        "action": torch.randint(4, (2, 1, 6), generator=g),
        "reward": torch.randn(2, 1, 6, dtype=torch.float64, generator=g),
        "terminal": torch.tensor([True, False, False, True, False, True]).expand(2, 1, 6),
    }


def full_gradients(p: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
    """Autograd's derivatives of the mean squared TD error with respect to q and q_next."""
    leaves = [p[name].clone().requires_grad_() for name in ("q", "q_next")]
    error = td_error(*leaves, p["action"], p["reward"], p["terminal"])
    return torch.autograd.grad(error.square().mean(-1).sum(), leaves)


def test_td_error_one_transition_at_a_time():
    p, gamma, kappa = problem(), 0.9, 5.0
    errors = td_error(**p, gamma=gamma, kappa=kappa)
    for r in range(2):
        for k in range(3):
            for b in range(6):
                value = mellowmax(p["q_next"][r, k, :, b], kappa)
                alive = 0.0 if p["terminal"][r, 0, b] else 1.0
                target = p["reward"][r, 0, b] + gamma * alive * value
                expected = target - p["q"][r, k, p["action"][r, 0, b], b]
                assert errors[r, k, b].item() == pytest.approx(expected.item(), abs=1e-12)


def test_td_error_passes_finite_differences():
    p = problem()
    leaves = [p[name].clone().requires_grad_() for name in ("q", "q_next")]
    rest = (p["action"], p["reward"], p["terminal"])
    assert torch.autograd.gradcheck(lambda q, q_next: td_error(q, q_next, *rest), leaves)


def test_psi_one_is_the_full_gradient():
    p = problem()
    for ours, autograd in zip(td_cotangent(**p, psi=1.0), full_gradients(p), strict=True):
        torch.testing.assert_close(ours, autograd)


def test_psi_zero_is_the_semi_gradient():
    p = problem()
    at_state, at_next = td_cotangent(**p, psi=0.0)
    torch.testing.assert_close(at_state, full_gradients(p)[0])
    assert not at_next.any()


def test_psi_scales_the_part_of_the_next_state_alone():
    p = problem()
    at_state, at_next = td_cotangent(**p, psi=1.0)
    for psi in (0.25, 0.5, 0.9):
        half_state, half_next = td_cotangent(**p, psi=psi)
        assert torch.equal(half_state, at_state)
        torch.testing.assert_close(half_next, psi * at_next)


def test_terminal_next_states_drop_out_of_target_and_gradient():
    p = problem()
    over = p["terminal"][0, 0]
    for psi in (0.0, 0.5, 1.0):
        at_state, at_next = td_cotangent(**p, psi=psi)
        assert not at_next[..., over].any()
        assert psi == 0 or (at_next[..., ~over] != 0).any()
        other = p | {"q_next": torch.where(over, p["q_next"] + 7.0, p["q_next"])}
        for before, after in zip((at_state, at_next), td_cotangent(**other, psi=psi), strict=True):
            torch.testing.assert_close(before, after)
    chosen = p["q"].gather(-2, p["action"].unsqueeze(-2).expand(2, 3, 1, 6)).squeeze(-2)
    torch.testing.assert_close(td_error(**p)[..., over], (p["reward"] - chosen)[..., over])


def test_gradient_flows_to_the_chosen_action_only():
    p = problem()
    at_state, _ = td_cotangent(**p, psi=1.0)
    chosen = torch.zeros_like(at_state, dtype=torch.bool)
    chosen.scatter_(-2, p["action"].unsqueeze(-2).expand(2, 3, 1, 6), True)
    assert not at_state[~chosen].any()
    assert (at_state[chosen] != 0).all()


def test_a_sharp_mellowmax_keeps_the_gradient_finite():
    p = problem(kappa_spread=1e3)
    for ours, autograd in zip(td_cotangent(**p, psi=1.0), full_gradients(p), strict=True):
        assert torch.isfinite(ours).all()
        torch.testing.assert_close(ours, autograd)


def test_arguments_are_left_alone():
    p = problem()
    before = {name: value.clone() for name, value in p.items()}
    td_cotangent(**p, psi=0.5)
    td_error(**p)
    mellowmax(p["q"], 100.0, -2)
    assert all(torch.equal(p[name], before[name]) for name in p)


@pytest.mark.parametrize("psi", [-0.1, 1.1, math.nan, math.inf])
def test_psi_outside_its_range_is_refused(psi):
    with pytest.raises(ValueError, match=r"psi must lie in \[0, 1\]"):
        check_psi(psi)


@pytest.mark.parametrize("psi", [0, 0.5, 1])
def test_psi_within_its_range_is_accepted(psi):
    check_psi(psi)
