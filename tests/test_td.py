"""Mellowmax, TD errors and their psi-mixed gradients, against definitions and autograd."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from vtlab.bases import RBFLinear
from vtlib import td
from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.td import exp_of_differences, mellowmax, td_error, td_gradients

VALUES = st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=8)
PROPERTY = settings(deadline=None, derandomize=True)
both_precisions = pytest.mark.parametrize("dtype", [torch.float32, torch.float64])


@PROPERTY
@given(VALUES, st.floats(1e-3, 1e3))
def test_mellowmax_equals_its_formula(values, kappa):
    x = torch.tensor(values, dtype=torch.float64)
    expected = (torch.logsumexp(kappa * x, 0) - math.log(len(values))) / kappa
    # float64 at values up to 1e3, with the division by kappa >= 1e-3
    torch.testing.assert_close(mellowmax(x, kappa), expected, rtol=0, atol=1e-9)


@both_precisions
@pytest.mark.parametrize("actions", [1, 2, 3, 4, 7])
def test_mellowmax_of_equal_values_is_exact(dtype, actions):
    levels = torch.tensor([0.0, 0.1, -3.3, 63.397, 1e4], dtype=dtype)
    x = levels.unsqueeze(-1).expand(-1, actions)
    for kappa in (1e-3, 1.0, 100.0):
        assert torch.equal(mellowmax(x, kappa), levels)


@both_precisions
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


@pytest.mark.parametrize("psi", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("q", [RBFLinear(torch.arange(-2.0, 3.0), 1.0, 3), MLP((2, 4, 5, 3))])
def test_gradients_are_autograds_however_few_are_taken_at_a_time(monkeypatch, q, psi):
    runs, k, size, g = 5, 4, 8, torch.Generator().manual_seed(1)
    obs, next_obs = torch.randn(2, runs, size, 2, generator=g)
    action = torch.randint(3, (runs, size), generator=g)
    reward, end = torch.randn(runs, size, generator=g), torch.rand(runs, size, generator=g) < 0.3
    w = 0.5 * torch.randn(runs, k, q.d, generator=g)
    leaf = w.clone().requires_grad_()
    now, after = (q.q(leaf, q.prepare(x)) for x in (obs, next_obs))
    after = psi * after + (1 - psi) * after.detach()
    error = td_error(now, after, *(x.unsqueeze(1) for x in (action, reward, end)), 0.9, 20.0)
    (expected,) = torch.autograd.grad(error.square().mean(-1).sum(), leaf)
    batch = Transition(obs, action, reward, next_obs, end)
    for limit in (td.CACHED, 2 * (2 * k * size * q.width), 1):  # all runs at once, two, one
        monkeypatch.setattr(td, "CACHED", limit)
        ours = td_gradients(q, w, batch, psi, 0.9, 20.0)
        torch.testing.assert_close(ours, expected, rtol=1e-3, atol=1e-5)
