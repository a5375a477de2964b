"""Standard deviations without correlations: gradients, limits and where the KL alone leads."""

from __future__ import annotations

import pytest
import torch

from vtlib.factor_diagonal import DiagonalFactors
from vtlib.gaussian import Gaussian, Precision, kl, low_rank_precision, sources_mean_and_spread

MEMBERS, D, WEIGHTS, ALPHA = 3, 6, 4, 0.01


def random(*shape: int, seed: int) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def prior(kind: str) -> tuple[Precision, torch.Tensor]:
    """A precision, and the Cholesky factors (M, d, d) of its inverse."""
    if kind == "isotropic":
        return Precision(5.0), torch.eye(D).expand(MEMBERS, D, D) / 5.0**0.5
    _, spread = sources_mean_and_spread(random(MEMBERS, 4, D, seed=1))
    covariance = spread @ spread.mT + 0.2 * torch.eye(D)
    return low_rank_precision(spread, 0.2), torch.linalg.cholesky(covariance)


def start() -> torch.Tensor:
    return torch.diag_embed(0.5 + random(MEMBERS, D, seed=2).abs())


@pytest.mark.parametrize("kind", ["isotropic", "low rank"])
def test_a_step_descends_the_expected_error_plus_the_kl(kind):
    precision, L_p = prior(kind)
    gradients, noise = random(MEMBERS, WEIGHTS, D, seed=3), random(MEMBERS, WEIGHTS, D, seed=4)
    factors = DiagonalFactors(start(), precision, ALPHA, 1e-4, 1000.0)
    sigma = start().diagonal(dim1=1, dim2=2).clone().requires_grad_()
    mean = torch.zeros(MEMBERS, D)
    divergence = kl(Gaussian(mean, torch.diag_embed(sigma)), Gaussian(mean, L_p)).sum()
    # an error linear in the weights w = sigma z, whose gradient at each sample is given
    (divergence * 0.3 + (gradients * noise * sigma.unsqueeze(1)).sum()).backward()
    factors.step(gradients, noise, 0.3)
    expected = torch.diag_embed(sigma.detach() - ALPHA * sigma.grad)
    torch.testing.assert_close(factors.L, expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("kind", ["isotropic", "low rank"])
def test_the_kl_alone_leads_to_the_best_diagonal_gaussian(kind):
    precision, L_p = prior(kind)
    factors = DiagonalFactors(start(), precision, ALPHA, 1e-4, 1000.0)
    nothing = torch.zeros(MEMBERS, 1, D)
    for _ in range(2000):
        factors.step(nothing, nothing, 1.0)
    mean = torch.zeros(MEMBERS, D)
    least = kl(Gaussian(mean, factors.L), Gaussian(mean, L_p))
    for i in range(D):
        for factor in (0.95, 1.05):
            other = factors.L
            other[:, i, i] *= factor
            assert (kl(Gaussian(mean, other), Gaussian(mean, L_p)) > least).all()
    torch.testing.assert_close(
        factors.L.diagonal(dim1=1, dim2=2), precision.diagonal(D).rsqrt().expand(MEMBERS, D)
    )


def test_gradients_are_clipped_and_deviations_held():
    factors = DiagonalFactors(start(), Precision(5.0), ALPHA, sigma_min=0.4, clip=2.0)
    gradients, noise = torch.zeros(MEMBERS, 1, D), torch.ones(MEMBERS, 1, D)
    gradients[0] = 100.0
    before = factors.L.diagonal(dim1=1, dim2=2).clone()
    factors.step(gradients, noise, 0.0)
    after = factors.L.diagonal(dim1=1, dim2=2)
    torch.testing.assert_close(after[0], before[0] - ALPHA * 2.0)
    assert torch.equal(after[1:], before[1:])
    for _ in range(200):
        factors.step(gradients, noise, 0.0)
    assert (factors.L[0].diagonal() == torch.tensor(0.4)).all()


def test_product_is_with_the_factor():
    factors = DiagonalFactors(start(), Precision(5.0), ALPHA, 1e-4, 1000.0)
    noise = random(1, MEMBERS, WEIGHTS, D, seed=5)
    factors.look_ahead(noise)
    torch.testing.assert_close(factors.product(0), noise[0] @ factors.L)


def test_a_start_below_sigma_min_is_lifted_to_it():
    L = 1e-6 * torch.eye(D).expand(1, D, D)
    lifted = DiagonalFactors(L, Precision(5.0), ALPHA, 0.1, 10.0).L[0]
    torch.testing.assert_close(lifted, 0.1 * torch.eye(D))
