"""KL divergence of Gaussians, its gradients and the precision of the prior, in float64."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.distributions import MultivariateNormal, kl_divergence

from vtlib import gaussian as gaussian_module
from vtlib.gaussian import (
    Gaussian,
    Precision,
    covariance_factor,
    kl,
    kl_gradients,
    low_rank_precision,
    sources_mean_and_spread,
)


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def draw(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(shape, dtype=torch.float64, generator=generator(seed))


def gaussian(*batch: int, d: int, seed: int) -> Gaussian:
    """Gaussians with well-conditioned full covariances."""
    lower = draw(*batch, d, d, seed=seed).tril(-1) / d**0.5
    diagonal = draw(*batch, d, seed=seed + 1).mul(0.3).exp()
    return Gaussian(draw(*batch, d, seed=seed + 2), lower + torch.diag_embed(diagonal))


def dense(precision: Precision, d: int) -> Tensor:
    """The matrix that a precision stands for."""
    return precision.times(torch.eye(d, dtype=torch.float64))


@pytest.mark.parametrize("d", [1, 2, 7, 30])
def test_kl_agrees_with_torch_distributions(d):
    q, p = gaussian(3, d=d, seed=1), gaussian(3, d=d, seed=5)
    q_torch = MultivariateNormal(q.mu, scale_tril=q.L)
    p_torch = MultivariateNormal(p.mu, scale_tril=p.L)
    torch.testing.assert_close(kl(q, p), kl_divergence(q_torch, p_torch))


def test_kl_equals_the_closed_form_with_determinants_and_inverses():
    q, p = gaussian(d=6, seed=1), gaussian(d=6, seed=5)
    cov_q, cov_p = q.L @ q.L.T, p.L @ p.L.T
    inverse, shift = torch.linalg.inv(cov_p), q.mu - p.mu
    volumes = (torch.linalg.det(cov_p) / torch.linalg.det(cov_q)).log()
    expected = 0.5 * (volumes + (inverse @ cov_q).trace() + shift @ inverse @ shift - 6)
    torch.testing.assert_close(kl(q, p), expected)


def test_kl_feels_entries_off_the_diagonal():
    p = Gaussian(torch.zeros(2).double(), torch.eye(2).double())
    q = Gaussian(p.mu, torch.tensor([[1.0, 0.0], [3.0, 1.0]]).double())
    assert kl(q, p) == pytest.approx(4.5)


def test_kl_of_equal_gaussians_is_zero_and_otherwise_positive():
    q, p = gaussian(20, d=5, seed=1), gaussian(20, d=5, seed=5)
    torch.testing.assert_close(kl(q, q), torch.zeros(20).double())
    assert (kl(q, p) > 0).all()


def test_kl_broadcasts_over_batch_axes():
    q, p = gaussian(4, 1, d=3, seed=1), gaussian(2, d=3, seed=5)
    table = kl(q, p)
    assert table.shape == (4, 2)
    one = kl(Gaussian(q.mu[2, 0], q.L[2, 0]), Gaussian(p.mu[1], p.L[1]))
    torch.testing.assert_close(table[2, 1], one)


def low_rank_problem(d: int, sources: int) -> tuple[Gaussian, Gaussian, Precision]:
    """A posterior, and a prior estimated from few sources with the precision of low rank."""
    mu_p, spread = sources_mean_and_spread(draw(2, sources, d, seed=9))
    prior = Gaussian(mu_p, covariance_factor(spread, 0.1))
    return gaussian(2, d=d, seed=1), prior, low_rank_precision(spread, 0.1)


@pytest.mark.parametrize("d", [1, 3, 8])
def test_gradients_agree_with_autograd(d):
    q, prior, precision = low_rank_problem(d, sources=4)
    leaves = [q.mu.clone().requires_grad_(), q.L.clone().requires_grad_()]
    loss = kl(Gaussian(*leaves), prior).sum()
    toward_mu, toward_factor = torch.autograd.grad(loss, leaves)
    ours = kl_gradients(q, prior.mu, precision)
    torch.testing.assert_close(ours[0], toward_mu)
    torch.testing.assert_close(ours[1], toward_factor.tril())


def test_gradients_agree_with_finite_differences():
    d, h = 4, 1e-6
    q, p = gaussian(d=d, seed=1), Gaussian(draw(d, seed=3), 0.5 * torch.eye(d).double())
    toward_mu, toward_factor = kl_gradients(q, p.mu, Precision(4.0))

    def slope(mu_step: Tensor, factor_step: Tensor) -> Tensor:
        ends = [Gaussian(q.mu + s * mu_step, q.L + s * factor_step) for s in (h, -h)]
        return (kl(ends[0], p) - kl(ends[1], p)) / (2 * h)

    unit, still = torch.eye(d * d).double(), torch.zeros(d, d).double()
    for i in range(d):
        assert slope(unit[i, :d], still) == pytest.approx(toward_mu[i].item(), abs=1e-7)
        for j in range(i + 1):
            step = unit[i * d + j].view(d, d)
            assert slope(still[0], step) == pytest.approx(toward_factor[i, j].item(), abs=1e-7)
    assert not toward_factor.triu(1).any()


def test_gradients_vanish_at_the_prior():
    _, prior, precision = low_rank_problem(6, sources=3)
    for gradient in kl_gradients(prior, prior.mu, precision):
        torch.testing.assert_close(gradient, torch.zeros_like(gradient))


def test_mean_and_covariance_of_sources_are_the_maximum_likelihood_estimates():
    sources = draw(2, 5, 4)
    mu, spread = sources_mean_and_spread(sources)
    torch.testing.assert_close(mu, sources.mean(1))
    for r in range(2):
        expected = torch.cov(sources[r].T, correction=0)
        torch.testing.assert_close(spread[r] @ spread[r].T, expected)


@pytest.mark.parametrize("at_once", [2, 4, 2**22])
@pytest.mark.parametrize("sources", [1, 2, 12])
def test_covariance_factor_is_the_cholesky_factor(sources, at_once, monkeypatch):
    monkeypatch.setattr(gaussian_module, "DOUBLES", at_once * 6**2)
    _, spread = sources_mean_and_spread(draw(5, sources, 6))
    L = covariance_factor(spread, 1e-4)
    covariance = spread @ spread.mT + 1e-4 * torch.eye(6).double()
    torch.testing.assert_close(L @ L.mT, covariance)
    assert not L.triu(1).any()
    assert (L.diagonal(dim1=-2, dim2=-1) > 0).all()


def test_covariance_factor_of_few_float32_sources_has_full_rank():
    _, spread = sources_mean_and_spread(draw(2, 3, 40).float())
    L = covariance_factor(spread, 1e-8)
    assert L.dtype == torch.float32
    assert (L.diagonal(dim1=-2, dim2=-1) >= 0.99e-4).all()


# one source has no spread at all, twelve span more than the six dimensions
@pytest.mark.parametrize("sources", [1, 2, 4, 12])
@pytest.mark.parametrize("jitter", [1e-4, 1.0])
def test_low_rank_precision_inverts_the_covariance(sources, jitter):
    _, spread = sources_mean_and_spread(draw(sources, 6))
    precision = dense(low_rank_precision(spread, jitter), 6)
    inverse = torch.linalg.inv(spread @ spread.T + jitter * torch.eye(6).double())
    torch.testing.assert_close(precision, inverse, rtol=1e-8, atol=1e-8)


def test_low_rank_precision_serves_a_batch():
    _, spread = sources_mean_and_spread(draw(3, 4, 6))
    batch = low_rank_precision(spread, 0.01)
    x = draw(3, 6, 2, seed=4)
    for r in range(3):
        alone = low_rank_precision(spread[r], 0.01).times(x[r])
        torch.testing.assert_close(batch.times(x)[r], alone)


def test_isotropic_precision_is_a_scalar():
    x = draw(5, 2)
    assert torch.equal(Precision(3.0).times(x), 3.0 * x)
