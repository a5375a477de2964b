"""The fast updates of the Cholesky factors against a slow one that inverts L at each step."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from vtlib import factor_deferred
from vtlib.factor import PANELS, CholeskyFactors
from vtlib.factor_deferred import DeferredFactors
from vtlib.gaussian import Precision, low_rank_precision, sources_mean_and_spread

STEPS = 500
SIZES = [1, 2, PANELS - 1, PANELS, PANELS + 1, 10, 23]
ALPHA, KL_WEIGHT = 0.05, 0.02


@pytest.fixture(params=[CholeskyFactors, DeferredFactors])
def factors(request, monkeypatch):
    """Either implementation; the diagonal blocks are narrow, so that small L have several."""
    monkeypatch.setattr(factor_deferred, "PANEL", 3)
    return request.param


class Dense:
    """Eqs. 5.9 and 5.11 as they are written, in float64, with no shortcut."""

    def __init__(self, L: Tensor, precision: Tensor, sigma_min: float, clip: float) -> None:
        self.L, self._precision = L.double().clone(), precision
        self._sigma_min, self._clip = sigma_min, clip
        self.L.diagonal(dim1=-2, dim2=-1).clamp_(min=sigma_min)
        self.clipped = self.clamped = 0

    def step(self, gradients: Tensor, noise: Tensor, kl_weight: float) -> None:
        outer = torch.einsum("mki,mkj->mij", gradients.double(), noise.double())
        pull = self._precision @ self.L - torch.linalg.inv(self.L).mT
        gradient = (outer + kl_weight * pull).tril()
        self.clipped += int((gradient.abs() > self._clip).any())
        self.L = self.L - ALPHA * gradient.clamp(-self._clip, self._clip)
        diagonal = self.L.diagonal(dim1=-2, dim2=-1)
        self.clamped += int((diagonal < self._sigma_min).any())
        diagonal.clamp_(min=self._sigma_min)


def prior(kind: str, members: int, d: int) -> tuple[Precision, Tensor]:
    """A precision and the dense matrix that it stands for."""
    eye = torch.eye(d, dtype=torch.float64)
    if kind == "isotropic":
        return Precision(5.0), 5.0 * eye
    sources = torch.randn(members, 4, d, generator=torch.Generator().manual_seed(7))
    _, spread = sources_mean_and_spread(sources)
    wide = spread.double()
    return low_rank_precision(spread, 0.2), torch.linalg.inv(wide @ wide.mT + 0.2 * eye)


def start(members: int, d: int) -> Tensor:
    g = torch.Generator().manual_seed(d)
    lower = 0.2 * torch.randn(members, d, d, generator=g).tril(-1)
    return lower + torch.diag_embed(0.5 + torch.rand(members, d, generator=g))


def inputs(members: int, d: int, scale: float, step: int) -> tuple[Tensor, Tensor]:
    """Noise (members, n, d), and gradients that on the whole shrink the factor."""
    g = torch.Generator().manual_seed(1000 + step)
    noise = torch.randn(members, 3, d, generator=g)
    gradients = scale * (0.2 * noise + torch.randn(members, 3, d, generator=g))
    # one step in 50 is far larger, as when a reward is found
    return (30.0 if step % 50 == 49 else 1.0) * gradients, noise


def compare(
    factors, kind: str, d: int, *, scale: float, sigma_min: float, clip: float, members: int = 3
) -> Dense:
    """Drive both through the same steps, compare them all the way, and return the dense one."""
    precision, matrix = prior(kind, members, d)
    fast = factors(start(members, d), precision, ALPHA, sigma_min, clip)
    slow = Dense(start(members, d), matrix, sigma_min, clip)
    for t in range(STEPS):
        gradients, noise = inputs(members, d, scale, t)
        weight = KL_WEIGHT * (1 + 3 * (t % 2))
        fast.step(gradients, noise, weight)
        slow.step(gradients, noise, weight)
        if t % 50 == 49:
            largest = slow.L.abs().max().item()
            torch.testing.assert_close(fast.L.double(), slow.L, rtol=0, atol=1e-5 * largest)
            assert not fast.L.triu(1).any()
    assert (fast.L.diagonal(dim1=-2, dim2=-1) >= sigma_min).all()
    return slow


@pytest.mark.parametrize("kind", ["isotropic", "low rank"])
@pytest.mark.parametrize("d", SIZES)
def test_steps_equal_the_dense_update(factors, kind, d):
    slow = compare(factors, kind, d, scale=0.02, sigma_min=1e-4, clip=1000.0)
    assert slow.clipped == 0


@pytest.mark.parametrize("kind", ["isotropic", "low rank"])
@pytest.mark.parametrize("d", [1, PANELS - 1, 10])
def test_steps_equal_the_dense_update_where_the_diagonal_is_held(factors, kind, d):
    slow = compare(factors, kind, d, scale=0.3, sigma_min=0.1, clip=1000.0)
    assert slow.clamped >= 10


@pytest.mark.parametrize("kind", ["isotropic", "low rank"])
@pytest.mark.parametrize("d", [1, PANELS - 1, 10])
@pytest.mark.parametrize("clip", [0.5, 2.0])
def test_steps_equal_the_dense_update_where_clipping_binds(factors, kind, d, clip):
    slow = compare(factors, kind, d, scale=0.1, sigma_min=0.05, clip=clip)
    assert 0 < slow.clipped < STEPS


@pytest.mark.parametrize("kind", ["isotropic", "low rank"])
def test_a_factor_that_has_grown_is_clipped(factors, kind):
    # the pull of the KL, harmless at the start, exceeds the clip once the entries are large
    precision, matrix = prior(kind, 1, 2)
    fast = factors(start(1, 2), precision, ALPHA, sigma_min=0.5, clip=20.0)
    slow = Dense(start(1, 2), matrix, sigma_min=0.5, clip=20.0)
    noise = torch.eye(2).unsqueeze(0)
    for t in range(52):
        weight = 0.0 if t < 50 else 1.0
        for each in (fast, slow):
            each.step(-4.0 * noise * (weight == 0), noise, weight)
        assert slow.clipped == max(0, t - 49)
        torch.testing.assert_close(fast.L.double(), slow.L, rtol=0, atol=1e-4)


def test_a_start_below_sigma_min_is_lifted_to_it(factors):
    # the bounds that decide about clipping rest on 1 / L_ii being at most 1 / sigma_min
    precision, matrix = prior("isotropic", 1, 4)
    L = 1e-4 * torch.eye(4).expand(1, 4, 4)
    fast = factors(L, precision, ALPHA, sigma_min=0.1, clip=10.0)
    slow = Dense(L, matrix, sigma_min=0.1, clip=10.0)
    nothing = torch.zeros(1, 2, 4)
    for _ in range(2):
        torch.testing.assert_close(fast.L.double(), slow.L, rtol=0, atol=1e-5)
        for each in (fast, slow):
            each.step(nothing, nothing, KL_WEIGHT)
    assert (L.diagonal(dim1=1, dim2=2) == 1e-4).all(), "the given L is not changed"


@pytest.mark.parametrize("d", SIZES)
def test_product_is_with_the_factor(factors, d):
    L = start(3, d)
    member = factors(L, Precision(1.0), ALPHA, 1e-4, 1000.0)
    noise = torch.randn(member.ahead, 3, 5, d, generator=torch.Generator().manual_seed(0))
    member.look_ahead(noise)
    for at in range(member.ahead):
        expected = torch.einsum("mij,mkj->mki", L.double(), noise[at].double())
        torch.testing.assert_close(member.product(at).double(), expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize("kind", ["isotropic", "low rank"])
def test_members_do_not_feel_each_other(factors, kind):
    members, d, chosen = 4, 10, 2
    precision, _ = prior(kind, members, d)
    W = None if precision.W is None else precision.W[chosen : chosen + 1]
    together = factors(start(members, d), precision, ALPHA, 1e-4, 3.0)
    alone = factors(
        start(members, d)[chosen : chosen + 1],
        Precision(precision.scale, W),
        ALPHA,
        1e-4,
        3.0,
    )
    for t in range(100):
        gradients, noise = inputs(members, d, 0.02, t)
        # a neighbour whose gradients are clipped must not clip the others
        gradients[0] *= 100.0
        together.step(gradients, noise, KL_WEIGHT)
        alone.step(gradients[chosen : chosen + 1], noise[chosen : chosen + 1], KL_WEIGHT)
    torch.testing.assert_close(together.L[chosen], alone.L[0], rtol=0, atol=1e-6)


def test_the_kl_alone_leads_to_the_prior(factors):
    precision, matrix = prior("low rank", 2, 5)
    member = factors(start(2, 5), precision, ALPHA, 1e-4, 1000.0)
    nothing = torch.zeros(2, 1, 5)
    for _ in range(3000):
        member.step(nothing, nothing, kl_weight=0.5)
    covariance = (member.L @ member.L.mT).double()
    torch.testing.assert_close(
        covariance @ matrix, torch.eye(5).double().expand(2, 5, 5), rtol=0, atol=1e-3
    )
