"""Divergences of Gaussians and mixtures, their gradients, and the priors made of sources."""

import math

import numpy as np
import pytest
import torch
from torch.distributions import Categorical, MixtureSameFamily, MultivariateNormal, kl_divergence

from vtlib import priors
from vtlib.priors import Gaussian, GaussianPrior, MixturePrior, kl, kl_bound, pairwise_kl

CASES = [(1, 1), (1, 4), (2, 1), (2, 3), (3, 3), (4, 2)]
close = torch.testing.assert_close


def draw(*shape, seed=0):
    g = torch.Generator().manual_seed(seed)
    return torch.randn(shape, dtype=torch.float64, generator=g)


def eye(d):
    return torch.eye(d, dtype=torch.float64)


def gaussian(*batch, d, seed=1):
    """Gaussians with well-conditioned full covariances."""
    lower = draw(*batch, d, d, seed=seed).tril(-1) / (2 * d**0.5)
    diagonal = draw(*batch, d, seed=seed + 1).mul(0.3).exp()
    return Gaussian(draw(*batch, d, seed=seed + 2), lower + torch.diag_embed(diagonal))


@pytest.mark.parametrize("d", [1, 2, 7, 30])
def test_kl_agrees_with_torch_distributions(d):
    q, p = gaussian(4, 1, d=d), gaussian(3, d=d, seed=5)
    close(kl(q, p), kl_divergence(*(MultivariateNormal(mu, scale_tril=L) for mu, L in (q, p))))


@pytest.mark.parametrize("at_once", [2, 4, 2**22])
# one source has no spread at all, twelve span more than the six dimensions
@pytest.mark.parametrize("sources", [1, 2, 4, 12])
@pytest.mark.parametrize("jitter", [1e-4, 1.0])
@pytest.mark.parametrize("ddof", [0, 1])
def test_a_gaussian_prior_has_the_moments_of_its_sources(
    monkeypatch, sources, jitter, ddof, at_once
):
    monkeypatch.setattr(priors, "DOUBLES", at_once * 6**2)
    w = draw(5, sources, 6)
    if sources == ddof:
        with pytest.raises(ValueError, match=r"^sources must be more than ddof = 1, got 1$"):
            GaussianPrior(w, jitter, ddof)
        return
    prior = GaussianPrior(w, jitter, ddof)
    start, span = prior.start(1, "sources"), prior.start(1, "span")
    assert (start.variance, span.variance) == (jitter, priors.SPAN_JITTER)
    assert torch.equal(start.spread, span.spread)
    covariance = torch.stack([torch.from_numpy(np.cov(x.T, ddof=ddof)) for x in w])
    covariance += jitter * eye(6)
    L = priors.covariance_factor(start.spread, jitter)
    close(L @ L.mT, covariance)
    assert not L.triu(1).any()
    inverse = prior.precision.times(eye(6).expand(5, 6, 6))
    close(inverse, torch.linalg.inv(covariance), rtol=1e-8, atol=1e-8)
    close(prior.precision.diagonal(6), inverse.diagonal(dim1=1, dim2=2))
    for mu in (start.mu, span.mu):
        close(mu, w.mean(1, keepdim=True))
        mu.add_(1.0)  # the posterior's means move in place, and must not take the prior along
        close(prior.pull(mu), inverse.sum(1, keepdim=True))


def tables(pairwise, updates):
    """Responsibilities after so many updates, however little they still change."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(priors, "MAX_UPDATES", updates)
        patch.setattr(priors, "TOLERANCE", 0.0)
        return priors.responsibilities(pairwise)


def tight_bound(pairwise, updates=None):
    found = tables(pairwise, updates) if updates is not None else priors.responsibilities(pairwise)
    return kl_bound(pairwise, *found)


def torch_mixture(mu, L):
    weights = Categorical(torch.ones(len(mu), dtype=torch.float64))
    return MixtureSameFamily(weights, MultivariateNormal(mu, scale_tril=L))


@pytest.mark.parametrize(("components", "sources"), CASES)
@pytest.mark.parametrize("d", [1, 3])
def test_bound_is_at_least_the_monte_carlo_kl(components, sources, d):
    q, w, samples = gaussian(components, d=d), draw(sources, d, seed=8), 100_000
    at = torch.randint(components, (samples,), generator=torch.Generator().manual_seed(0))
    x = q.mu[at] + (q.scale_tril[at] @ draw(samples, d, 1, seed=9)).squeeze(-1)
    prior = torch_mixture(w, 0.7**0.5 * eye(d).expand(sources, d, d))
    ratio = torch_mixture(*q).log_prob(x) - prior.log_prob(x)
    error = ratio.std() / samples**0.5
    assert error < 0.05
    assert tight_bound(pairwise_kl(q, w, 0.7)) >= ratio.mean() - 4 * error


def test_pairwise_kl_is_a_table_of_closed_forms_which_are_the_bounds_of_single_gaussians():
    q, w = gaussian(2, 3, d=4), draw(2, 5, 4, seed=8)
    each = Gaussian(q.mu.unsqueeze(2), q.scale_tril.unsqueeze(2))
    table = kl(each, Gaussian(w.unsqueeze(1), 0.3**0.5 * eye(4)))
    close(pairwise_kl(q, w, 0.3), table)
    close(tight_bound(table[..., None, None]), table)


@pytest.mark.parametrize("updates", [0, 1, 7])
def test_an_update_is_equations_5_14_and_5_15_and_the_first_phi_is_uniform(updates):
    pairwise = draw(3, 4).square()
    theta, phi = (x.exp() for x in tables(pairwise, updates))
    before = tables(pairwise, max(0, updates - 1))[0].exp()
    close(phi, before / before.sum(0) / 4 if updates else torch.full((3, 4), 1 / 12).double())
    boltzmann = phi * (-pairwise).exp()
    close(theta, boltzmann / boltzmann.sum(1, keepdim=True) / 3)


def test_converged_bound_is_near_its_limit_and_feels_no_order():
    rows, columns = torch.tensor([2, 0, 1]), torch.tensor([4, 1, 0, 3, 2, 5])
    for seed in range(5):
        pairwise = 3 * draw(3, 6, seed=seed).square()
        limit = tight_bound(pairwise, 1000)
        assert limit - 1e-9 <= tight_bound(pairwise) <= limit + 0.02
        moved = priors.responsibilities(pairwise[rows][:, columns])
        # nor what other runs of the batch are like
        beside = priors.responsibilities(torch.stack([50 * pairwise, pairwise, 0.01 * pairwise]))
        for alone, other, batch in zip(
            priors.responsibilities(pairwise), moved, beside, strict=True
        ):
            close(other.exp(), alone[rows][:, columns].exp())
            close(batch[1].exp(), alone.exp(), rtol=0, atol=1e-9)


@pytest.mark.parametrize("components", [1, 3, 10])
def test_far_sources_in_484_dimensions(components):
    w = 0.2 * draw(10, 484).float()
    L = 1e-5**0.5 * torch.eye(484).expand(components, -1, -1)
    for mu in (w.mean(0).expand(components, -1), 0.2 * draw(components, 484, seed=1).float()):
        pairwise = pairwise_kl(Gaussian(mu, L), w, 1e-5)
        assert 1e5 < pairwise.max() < 1e7
        assert torch.isfinite(tight_bound(pairwise))
        assert torch.isfinite(MixturePrior(w, 1e-5).pull(mu)).all()
    # where each component explains its own source, log S - log C is what remains
    q = Gaussian(w[:components].double(), L.double())
    bound = tight_bound(pairwise_kl(q, w.double(), 1e-5))
    assert bound.item() == pytest.approx(math.log(10 / components), abs=1e-9)
    # Adam divides by the gradient's size: a mere rounding error would move the means
    assert not MixturePrior(w, 1e-5).pull(w[:components]).any()


@pytest.mark.parametrize(("components", "sources"), CASES)
def test_pull_is_the_gradient_of_the_tightened_bound(components, sources):
    q, w, variance, h = gaussian(components, d=4), draw(sources, 4, seed=8), 0.9, 1e-3
    # theta and phi are tightened anew at either end: at their fixed point the bound is flat in them
    wide = 2.5 * q.mu
    steps = h * eye(wide.numel()).view(-1, *wide.shape)
    ends = Gaussian(torch.stack([wide + steps, wide - steps]), q.scale_tril)
    above, below = tight_bound(pairwise_kl(ends, w, variance), 1000)
    slopes = ((above - below) / (2 * h)).view_as(wide)
    close(MixturePrior(w, variance).pull(wide), slopes, rtol=0, atol=0.01)


@pytest.mark.parametrize("components", [1, 2, 5])
def test_mixture_prior_starts_on_different_sources_or_at_their_mean(components):
    sources = draw(2, 3, 4)
    before = sources.clone()
    prior = MixturePrior(sources, 0.5)
    close(prior.precision.times(eye(4)), eye(4) / 0.5)
    on, mean = prior.start(components, "sources"), prior.start(components, "mean")
    assert torch.equal(on.mu, sources[:, [0, 1, 2, 0, 1][:components]])
    close(mean.mu, sources.mean(1, keepdim=True).expand(2, components, 4))
    for start in (on, mean):
        assert (start.variance, start.spread) == (0.5, None)
        start.mu.add_(1.0)
        close(prior.pull(start.mu), MixturePrior(before, 0.5).pull(start.mu))


def test_equal_responsibilities_are_the_bound_with_a_uniform_table():
    sources, mu = draw(1, 4, 3), draw(1, 2, 3, seed=1).requires_grad_()
    pairwise = pairwise_kl(Gaussian(mu, 0.5 * eye(3).expand(1, 2, 3, 3)), sources, 0.7)
    uniform = torch.full((1, 2, 4), -math.log(8)).double()
    (expected,) = torch.autograd.grad(kl_bound(pairwise, uniform, uniform), mu)
    close(MixturePrior(sources, 0.7, "equal").pull(mu.detach()), expected)
