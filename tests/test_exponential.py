"""Exponentials of differences: exact where they count, zero where a sum would lose them."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from vtlib.exponential import exp_of_differences


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@settings(deadline=None, derandomize=True)
@given(x=st.lists(st.floats(-1e4, 0), min_size=1, max_size=20))
def test_a_sum_with_one_is_the_same_to_rounding(dtype, x):
    eps = torch.finfo(dtype).eps
    ours = exp_of_differences(torch.tensor(x, dtype=dtype)).double()
    exact = torch.tensor(x, dtype=dtype).double().exp()
    assert float((ours - exact).abs().max()) <= 2 * eps
    kept = ours > 0
    torch.testing.assert_close(ours[kept], exact[kept], rtol=4 * eps, atol=0)
    assert not exact[~kept].gt(1.01 * eps).any()


def test_nothing_is_denormal():
    x = exp_of_differences(torch.linspace(-200, 0, 10_001))
    assert x[-1] == 1
    assert x[x > 0].min() > 1e-8
    assert x[0] == 0


def test_autograd_passes_through():
    x = torch.linspace(-3, 0, 7, dtype=torch.float64, requires_grad=True)
    exp_of_differences(1 * x).sum().backward()
    torch.testing.assert_close(x.grad, x.detach().exp())
