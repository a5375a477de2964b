"""Radial bases: values against the naive formula, gradients against autograd."""

import pytest
import torch

from vtlab.bases import RBFLinear

ROUNDING = {"rtol": 1e-4, "atol": 1e-5}  # of float32 sums over a few dozen terms


def draw(*shape, seed=0):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


# the corners, the centres and the middles between centres are the extreme cases, and far outside
POINTS = [(0.0, 0.0), (10.0, 10.0), (4.0, 7.0), (4.5, 6.5), (9.99, 0.01), (-4.0, 5.0), (14.0, 13.0)]
SPOTS = torch.cat([10 * torch.rand(100, 2, generator=torch.Generator()), torch.tensor(POINTS)])


@pytest.mark.parametrize(
    ("centers", "variance"),
    [(torch.arange(11.0), 1 / 9), (torch.tensor([-1.0, 0.0, 0.5, 9.0]), 0.2)],
)
def test_bases_equal_the_naive_formula(centers, variance):
    q = RBFLinear(centers, variance, n_actions=3)
    assert (q.d, q.n_actions) == (3 * len(centers) ** 2, 3)
    obs = torch.stack([SPOTS, SPOTS.flip(0)])
    grid = torch.cartesian_prod(centers.double(), centers.double())  # x is the slow index
    squares = (obs.double().unsqueeze(-2) - grid).square().sum(-1)
    x, naive = q.prepare(obs), torch.softmax(-0.5 * squares / variance, -1)
    torch.testing.assert_close(x.mT.double(), naive, rtol=0, atol=1e-6)
    assert x[x > 0].min() >= torch.finfo(torch.float32).tiny, "nothing may be denormal"
    w = draw(2, 5, q.d).double().requires_grad_()
    expected = torch.einsum("rkaf,rbf->rkab", w.unflatten(-1, (3, -1)), naive)
    values, pullback = q.vjp(w.detach().float(), x)
    torch.testing.assert_close(values.double(), expected.detach(), rtol=0, atol=1e-5)
    cotangent = draw(*values.shape, seed=2)
    (gradient,) = torch.autograd.grad(expected, w, cotangent.double())
    torch.testing.assert_close(pullback(cotangent), gradient.float(), **ROUNDING)
