"""Q-functions over flat weights: values against naive formulas, gradients against autograd."""

from __future__ import annotations

from itertools import pairwise

import pytest
import torch
from torch import Tensor, nn

from vtlib.qfunctions import MLP, ModuleQ, RBFLinear

ROUNDING = {"rtol": 1e-4, "atol": 1e-5}  # of float32 sums over a few dozen terms
SIZES = [(4, 32, 2), (2, 5, 7, 3), (3, 2)]


def draw(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def spots(runs: int, batch: int) -> Tensor:
    """Observations (runs, batch, 2) all over the rooms' square."""
    return 10 * torch.rand(runs, batch, 2, generator=torch.Generator().manual_seed(0))


def rooms_bases() -> RBFLinear:
    return RBFLinear(torch.arange(11.0), 1 / 9, n_actions=4)


def network(sizes: tuple[int, ...]) -> nn.Sequential:
    layers: list[nn.Module] = []
    for into, out in pairwise(sizes):
        layers += [nn.Linear(into, out), nn.ReLU()]
    return nn.Sequential(*layers[:-1])


def load(module: nn.Module, w: Tensor) -> nn.Module:
    """The module with flat weights w (d,), by torch's own order of parameters."""
    nn.utils.vector_to_parameters(w, module.parameters())
    return module


def naive_features(obs: Tensor, centers: Tensor, variance: float) -> Tensor:
    """Normalised bases of observations (..., 2) in float64, x the slow index."""
    grid = torch.cartesian_prod(centers.double(), centers.double())
    squares = (obs.double().unsqueeze(-2) - grid).square().sum(-1)
    return torch.softmax(-0.5 * squares / variance, -1)


def features(q: RBFLinear, obs: Tensor) -> Tensor:
    """Features (R, B, m * m) as the values of action 0 under unit weights, in float64."""
    units = torch.eye(q.d // q.n_actions, q.d).expand(len(obs), -1, -1)
    return q.q(units, q.prepare(obs))[:, :, 0].mT.double()


def assert_pullback_is_autograd(q, w: Tensor, obs: Tensor) -> None:
    x = q.prepare(obs)
    leaf = w.clone().requires_grad_()
    values = q.q(leaf, x)
    cotangent = draw(*values.shape, seed=9)
    (expected,) = torch.autograd.grad(values, leaf, cotangent)
    ours, pullback = q.vjp(w, x)
    torch.testing.assert_close(ours, values.detach(), **ROUNDING)
    gradient = pullback(cotangent)
    assert gradient.shape == w.shape
    torch.testing.assert_close(gradient, expected, **ROUNDING)


def test_rooms_bases_have_484_weights():
    assert rooms_bases().d == 484


def test_rbf_features_sum_to_one():
    x = features(rooms_bases(), spots(5, 200))
    assert (x >= 0).all()
    torch.testing.assert_close(x.sum(-1), torch.ones(5, 200).double(), rtol=0, atol=1e-5)


# the corners, the centres and the middles between centres are the extreme cases
@pytest.mark.parametrize("obs", [(0.0, 0.0), (10.0, 10.0), (4.0, 7.0), (4.5, 6.5), (9.99, 0.01)])
def test_rbf_features_equal_the_naive_formula(obs):
    point = torch.tensor([[obs]])
    naive = naive_features(point, torch.arange(11.0), 1 / 9)
    ours = features(rooms_bases(), point)
    torch.testing.assert_close(ours, naive, rtol=0, atol=1e-6)


@pytest.mark.parametrize("obs", [(-4.0, 5.0), (14.0, 13.0)])
def test_rbf_features_far_from_all_centers_are_those_of_the_nearest(obs):
    point = torch.tensor([[obs]])
    naive = naive_features(point, torch.arange(11.0), 1 / 9)
    torch.testing.assert_close(features(rooms_bases(), point), naive, rtol=0, atol=1e-6)


def test_rbf_features_on_a_coarse_grid_equal_the_naive_formula():
    centers = torch.tensor([-1.0, 0.0, 0.5, 9.0])
    obs = spots(3, 100)
    ours = features(RBFLinear(centers, 0.2, 3), obs)
    torch.testing.assert_close(ours, naive_features(obs, centers, 0.2), rtol=0, atol=1e-6)


def test_rbf_features_hold_no_denormal_numbers():
    x = rooms_bases().prepare(spots(1, 500))
    assert x[x > 0].min() >= torch.finfo(torch.float32).tiny


def test_rbf_values_are_a_linear_combination():
    q, w = rooms_bases(), draw(2, 3, 484)
    obs = spots(2, 6)
    values = q.q(w, q.prepare(obs))
    assert values.shape == (2, 3, 4, 6)
    naive = naive_features(obs, torch.arange(11.0), 1 / 9)
    expected = torch.einsum("rkaf,rbf->rkab", w.double().view(2, 3, 4, 121), naive)
    torch.testing.assert_close(values.double(), expected, rtol=0, atol=1e-5)


def test_rbf_pullback_is_autograd():
    obs = spots(2, 6)
    assert_pullback_is_autograd(rooms_bases(), draw(2, 3, 484), obs)


@pytest.mark.parametrize("variance", [0.0, -1.0, float("nan")])
def test_rbf_refuses_other_variances(variance):
    with pytest.raises(ValueError, match="variance must be positive"):
        RBFLinear(torch.arange(3.0), variance, 4)


@pytest.mark.parametrize(
    ("sizes", "d"), [((4, 32, 2), 226), ((2, 64, 3), 387), ((22, 32, 32, 3), 1891)]
)
def test_mlp_counts_its_weights(sizes, d):
    q = MLP(sizes)
    assert (q.d, q.n_actions) == (d, sizes[-1])


@pytest.mark.parametrize("sizes", SIZES)
def test_mlp_equals_the_torch_module_of_the_same_flat_weights(sizes):
    q = MLP(sizes)
    w, obs = draw(2, 3, q.d), draw(2, 6, sizes[0], seed=1)
    values, pullback = q.vjp(w, q.prepare(obs))
    assert values.shape == (2, 3, sizes[-1], 6)
    cotangent = draw(*values.shape, seed=2)
    gradient = pullback(cotangent)
    for r in range(2):
        for k in range(3):
            module = load(network(sizes), w[r, k])
            out = module(obs[r])
            torch.testing.assert_close(values[r, k], out.T, **ROUNDING)
            parts = torch.autograd.grad(out, list(module.parameters()), cotangent[r, k].T)
            flat = torch.cat([part.flatten() for part in parts])
            torch.testing.assert_close(gradient[r, k], flat, **ROUNDING)


@pytest.mark.parametrize("sizes", SIZES)
def test_module_equals_the_mlp(sizes):
    ours, theirs = ModuleQ(network(sizes), sizes[-1]), MLP(sizes)
    assert (ours.d, ours.n_actions) == (theirs.d, theirs.n_actions)
    w, obs = draw(2, 3, ours.d), draw(2, 6, sizes[0], seed=1)
    values, pullback = ours.vjp(w, ours.prepare(obs))
    expected, expected_pullback = theirs.vjp(w, theirs.prepare(obs))
    torch.testing.assert_close(values, expected, **ROUNDING)
    torch.testing.assert_close(ours.q(w, obs), expected, **ROUNDING)
    cotangent = draw(*values.shape, seed=2)
    torch.testing.assert_close(pullback(cotangent), expected_pullback(cotangent), **ROUNDING)


def test_module_of_another_architecture_equals_autograd():
    module = nn.Sequential(nn.Linear(3, 8), nn.Tanh(), nn.LayerNorm(8), nn.Linear(8, 2, bias=False))
    q = ModuleQ(module, 2)
    assert q.d == 3 * 8 + 8 + 8 + 8 + 16
    w, obs = draw(2, 2, q.d), draw(2, 5, 3, seed=1)
    values, pullback = q.vjp(w, obs)
    cotangent = draw(*values.shape, seed=2)
    gradient = pullback(cotangent)
    for r in range(2):
        for k in range(2):
            out = load(module, w[r, k])(obs[r])
            torch.testing.assert_close(values[r, k], out.T.detach(), **ROUNDING)
            parts = torch.autograd.grad(out, list(module.parameters()), cotangent[r, k].T)
            flat = torch.cat([part.flatten() for part in parts])
            torch.testing.assert_close(gradient[r, k], flat, **ROUNDING)


def test_module_weights_come_back_from_flatten():
    w = draw(MLP((4, 32, 2)).d)
    q = ModuleQ(network((4, 32, 2)), 2)
    assert torch.equal(q.flatten(load(network((4, 32, 2)), w)), w)


def test_module_is_only_read():
    module = network((4, 8, 2))
    before = [p.detach().clone() for p in module.parameters()]
    q = ModuleQ(module, 2)
    _, pullback = q.vjp(draw(1, 2, q.d), draw(1, 5, 4))
    pullback(torch.ones(1, 2, 2, 5))
    assert all(torch.equal(p, b) for p, b in zip(module.parameters(), before, strict=True))
    assert all(p.grad is None for p in module.parameters())


@pytest.mark.parametrize("sizes", [(), (4,), (4, 0, 2), (-1, 2)])
def test_mlp_refuses_other_sizes(sizes):
    with pytest.raises(ValueError, match="at least two positive layer sizes"):
        MLP(sizes)


@pytest.mark.parametrize(
    "q",
    [rooms_bases(), MLP((2, 6, 3)), ModuleQ(network((2, 6, 3)), 3)],
    ids=["rbf", "mlp", "module"],
)
def test_runs_and_weight_vectors_do_not_feel_each_other(q):
    w, obs = draw(3, 4, q.d), 5 + draw(3, 6, 2, seed=1)
    values, pullback = q.vjp(w, q.prepare(obs))
    cotangent = draw(*values.shape, seed=2)
    alone, alone_pullback = q.vjp(w[1:2, 2:3], q.prepare(obs[1:2]))
    torch.testing.assert_close(values[1, 2], alone[0, 0], **ROUNDING)
    own = alone_pullback(cotangent[1:2, 2:3])[0, 0]
    torch.testing.assert_close(pullback(cotangent)[1, 2], own, **ROUNDING)
