"""Q-functions over flat weights: values against naive formulas, gradients against autograd."""

from itertools import pairwise

import pytest
import torch
from torch import nn

from vtlib.qfunctions import MLP, ModuleQ

ROUNDING = {"rtol": 1e-4, "atol": 1e-5}  # of float32 sums over a few dozen terms


def draw(*shape, seed=0):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def network(*sizes):
    layers = [layer for into, out in pairwise(sizes) for layer in (nn.Linear(into, out), nn.ReLU())]
    return nn.Sequential(*layers[:-1])


def test_parameters_that_require_no_gradient_stay_as_they_are():
    module = network(4, 8, 2)
    module[0].requires_grad_(False)
    q, w, obs = ModuleQ(module, 2), draw(1, 2, 18), draw(1, 5, 4, seed=1)
    assert q.d == 18
    values, pullback = q.vjp(w, obs)
    hidden = module[0](obs[0]).relu().detach()
    for k in range(2):
        expected = w[0, k, :16].view(2, 8) @ hidden.T + w[0, k, 16:].unsqueeze(1)
        torch.testing.assert_close(values[0, k], expected, **ROUNDING)
    assert pullback(torch.ones_like(values)).shape == w.shape
    assert torch.equal(q.flatten(module)[:16], module[2].weight.detach().flatten())
    with pytest.raises(ValueError, match=r"module must have the parameters 2.weight .2, 8"):
        q.flatten(network(4, 7, 2))


SHALLOW, DEEP, LINEAR = network(4, 32, 2), network(2, 5, 7, 3), network(3, 2)
OTHER = nn.Sequential(nn.Linear(3, 8), nn.Tanh(), nn.LayerNorm(8), nn.Linear(8, 2, bias=False))


@pytest.mark.parametrize(
    ("q", "module"),
    [
        (MLP((4, 32, 2)), SHALLOW),
        (MLP((2, 5, 7, 3)), DEEP),
        (MLP((3, 2)), LINEAR),
        *((ModuleQ(module, module[-1].out_features), module) for module in (SHALLOW, DEEP, OTHER)),
    ],
)
def test_networks_equal_the_torch_module_of_the_same_flat_weights(q, module):
    w, obs = draw(2, 3, q.d), draw(2, 6, module[0].in_features, seed=1)
    before, own = w.clone(), nn.utils.parameters_to_vector(module.parameters())
    values, pullback = q.vjp(w, q.prepare(obs))
    torch.testing.assert_close(q.q(w, q.prepare(obs)), values, **ROUNDING)
    cotangent = draw(*values.shape, seed=2)
    gradient = pullback(cotangent)
    assert torch.equal(w, before)
    assert torch.equal(pullback(cotangent), gradient)
    assert torch.equal(nn.utils.parameters_to_vector(module.parameters()), own)
    assert all(p.grad is None for p in module.parameters())
    for r, k in torch.cartesian_prod(torch.arange(2), torch.arange(3)).tolist():
        nn.utils.vector_to_parameters(w[r, k], module.parameters())
        out = module(obs[r])
        torch.testing.assert_close(values[r, k], out.T.detach(), **ROUNDING)
        parts = torch.autograd.grad(out, list(module.parameters()), cotangent[r, k].T)
        flat = torch.cat([part.flatten() for part in parts])
        torch.testing.assert_close(gradient[r, k], flat, **ROUNDING)
        assert not isinstance(q, ModuleQ) or torch.equal(q.flatten(module), w[r, k])
