"""Putting off most of the update of L changes neither L nor its products with the noise."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from vtlib import factor_deferred
from vtlib.factor import CholeskyFactors
from vtlib.factor_deferred import AHEAD, PANEL, DeferredFactors
from vtlib.gaussian import Precision, low_rank_precision, sources_mean_and_spread

STEPS, MEMBERS, WEIGHTS = 500, 2, 3
ALPHA, SIGMA_MIN, CLIP = 1e-3, 0.25, 1000.0
D = 2 * PANEL + PANEL // 2


def prior(kind: str, d: int) -> Precision:
    if kind == "isotropic":
        return Precision(5.0)
    sources = torch.randn(MEMBERS, 4, d, generator=torch.Generator().manual_seed(7))
    return low_rank_precision(sources_mean_and_spread(sources)[1], 0.2)


def draws(seed: int, d: int, scale: float) -> tuple[Tensor, Tensor]:
    """Noise (AHEAD, M, n + 1, d) and gradients (AHEAD, M, n, d) that shrink the factor."""
    g = torch.Generator().manual_seed(seed)
    noise = torch.randn(AHEAD, MEMBERS, WEIGHTS + 1, d, generator=g)
    other = torch.randn(AHEAD, MEMBERS, WEIGHTS, d, generator=g)
    return noise, scale * (0.2 * noise[:, :, 1:] + other)


def pair(kind: str, d: int, clip: float = CLIP) -> tuple[DeferredFactors, CholeskyFactors]:
    L = 0.3 * torch.eye(d).repeat(MEMBERS, 1, 1)
    L += 0.01 * torch.randn(L.shape, generator=torch.Generator().manual_seed(1)).tril(-1)
    return tuple(
        factors(L, prior(kind, d), ALPHA, SIGMA_MIN, clip)
        for factors in (DeferredFactors, CholeskyFactors)
    )


def assert_alike(
    deferred: DeferredFactors,
    plain: CholeskyFactors,
    steps: int,
    scale: float,
    strength: float = 3.0,
):
    """Both take the same steps; every product and the factors agree to float32 accuracy."""
    for t in range(steps):
        if t % AHEAD == 0:
            noise, gradients = draws(t, deferred.L.shape[-1], scale)
            deferred.look_ahead(noise)
        plain.look_ahead(noise[t % AHEAD : t % AHEAD + 1])
        expected = plain.product(0)
        close = 2e-5 * float(expected.abs().max())
        torch.testing.assert_close(deferred.product(t % AHEAD), expected, rtol=0, atol=close)
        weight = strength / (t + 1)
        for each in (deferred, plain):
            each.step(gradients[t % AHEAD], noise[t % AHEAD, :, 1:], weight)
    close = 2e-5 * float(plain.L.abs().max())
    torch.testing.assert_close(deferred.L, plain.L, rtol=0, atol=close)


@pytest.mark.parametrize("kind", ["isotropic", "low rank"])
def test_five_hundred_steps_equal_the_plain_update_with_the_diagonal_held(kind):
    deferred, plain = pair(kind, D)
    assert_alike(deferred, plain, STEPS, scale=0.3)
    held = plain.L.diagonal(dim1=1, dim2=2) == SIGMA_MIN
    assert 10 < int(held.sum()) < held.numel()


@pytest.mark.parametrize("kind", ["isotropic", "low rank"])
@pytest.mark.parametrize("d", [1, PANEL, PANEL + 1])
def test_any_size_will_do(kind, d):
    assert_alike(*pair(kind, d), 3 * AHEAD, scale=0.3)


@pytest.mark.parametrize("kind", ["isotropic", "low rank"])
def test_a_strong_pull_of_the_kl(kind):
    # what is kept of W^T L has to shrink with L
    assert_alike(*pair(kind, D), 3 * AHEAD, scale=0.05, strength=60.0)


def test_a_scale_that_falls_fast_is_applied_in_time(monkeypatch):
    monkeypatch.setattr(factor_deferred, "LEAST_SCALE", 0.999)
    assert_alike(*pair("isotropic", D), 3 * AHEAD, scale=0.3)


def test_clipping_in_the_middle_of_what_is_put_off():
    deferred, plain = pair("low rank", D, clip=0.5)
    free, _ = pair("low rank", D)
    assert_alike(deferred, plain, 3 * AHEAD, scale=0.05)
    noise, gradients = draws(0, D, 0.05)
    free.step(gradients[0], noise[0, :, 1:], 10.0)
    held, _ = pair("low rank", D, clip=0.5)
    held.step(gradients[0], noise[0, :, 1:], 10.0)
    assert not torch.allclose(free.L, held.L, rtol=0, atol=1e-4)


FEW, HALF = [0, 5, PANEL, 2 * PANEL - 1, D - 1], range(0, D, 2)


@pytest.mark.parametrize("kind", ["isotropic", "low rank"])
@pytest.mark.parametrize("strength", [0.0, 3.0])
@pytest.mark.parametrize(
    ("first", "rows", "unused"),
    [(FEW, FEW, "_write_out"), (HALF, HALF, "_clip_rows"), (FEW, HALF, None), (HALF, FEW, None)],
    ids=["in few rows", "in half of them", "in few, then in many", "in many, then in few"],
)
def test_clipping_that_binds(monkeypatch, kind, strength, first, rows, unused):
    if unused:
        monkeypatch.setattr(DeferredFactors, unused, None)
    monkeypatch.setattr(factor_deferred, "LEAST_SCALE", 0.9)
    deferred, plain = pair(kind, D, clip=100.0)
    free, _ = pair(kind, D, clip=1e9)
    for t in range(4 * AHEAD):
        if t % AHEAD == 0:
            noise, gradients = draws(t, D, 0.3)
            # in one member at many steps, in both at some, in the last row by an infinity
            gradients[1:3, 0, :, first[:-1]] *= 1000.0
            gradients[5:, 0, :, rows[:-1]] *= 1000.0
            gradients[5, 1, 0, rows[1:]] *= -1000.0
            gradients[6, 1, 1, rows[-1]] = torch.inf
            gradients[6, 1, 1, rows[:-1]] *= 1000.0
            deferred.look_ahead(noise)
        plain.look_ahead(noise[t % AHEAD : t % AHEAD + 1])
        expected = plain.product(0)
        close = 2e-5 * float(expected.abs().max())
        torch.testing.assert_close(deferred.product(t % AHEAD), expected, rtol=0, atol=close)
        for each in (deferred, plain):
            each.step(gradients[t % AHEAD], noise[t % AHEAD, :, 1:], strength / (t + 1))
        if t < 6:
            free.step(gradients[t], noise[t, :, 1:], strength / (t + 1))
    close = 2e-5 * float(plain.L.abs().max())
    torch.testing.assert_close(deferred.L, plain.L, rtol=0, atol=close)
    assert float((free.L - plain.L).abs().max()) > 1


@pytest.mark.parametrize("rows", [FEW, HALF], ids=["few rows", "half of them"])
def test_a_step_too_large_for_float32_is_no_error(rows):
    deferred, _ = pair("isotropic", D, clip=1e3)
    deferred = DeferredFactors(deferred.L, Precision(1.0), 1e38, 1e-3, 1e3)
    noise, gradients = draws(0, D, 0.3)
    gradients[..., rows] *= 1e6
    deferred.look_ahead(noise)
    for t in range(3):
        deferred.step(gradients[t], noise[t, :, 1:], 0.0)
    assert not torch.isfinite(deferred.L).all() or float(deferred.L.abs().max()) > 1e30


def test_a_maze_posterior_takes_little_more_memory_than_its_factor():
    d, weights = 1891, 10
    member = DeferredFactors(torch.eye(d).unsqueeze(0), Precision(1e5), 1e-6, 1e-4, CLIP)
    noise = torch.zeros(AHEAD, 1, weights + 1, d)
    member.look_ahead(noise)
    for t in range(AHEAD):
        member.product(t)
        member.step(torch.zeros(1, weights, d), noise[t, :, 1:], 1e-6)
    held = [x for x in vars(member).values() if isinstance(x, Tensor)]
    assert 4 * d**2 < sum(x.numel() * x.element_size() for x in held) < 19e6


def test_looking_at_L_disturbs_nothing():
    looked, alone = pair("low rank", D)[0], pair("low rank", D)[0]
    noise, gradients = draws(0, D, 0.3)
    for each in (looked, alone):
        each.look_ahead(noise)
    for t in range(AHEAD):
        assert looked.L.shape == (MEMBERS, D, D)
        for each in (looked, alone):
            each.step(gradients[t], noise[t, :, 1:], 0.1)
        torch.testing.assert_close(looked.product(t), alone.product(t), rtol=0, atol=2e-5)
    assert torch.equal(looked.L, looked.L.tril())
