"""The sampled KL of mixtures against closed forms and quadrature, and the bound against both."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.distributions import Categorical, MixtureSameFamily, MultivariateNormal

from vtlib.gaussian import Gaussian, kl
from vtlib.illustrations import mixture_kl
from vtlib.illustrations.mixture_kl import (
    PLACES,
    SOURCES,
    VARIANCE,
    bound_picture,
    compare,
    kernels,
    log_density,
    monte_carlo_kl,
    posterior,
)

PRIOR = kernels(torch.tensor(SOURCES, dtype=torch.float64).unsqueeze(1), VARIANCE)


def generator() -> np.random.Generator:
    return np.random.default_rng(3)


def quadrature_kl(q: Gaussian, p: Gaussian) -> float:
    """KL of two mixtures on a line by the trapezoidal rule on a fine grid."""
    x = torch.linspace(-9, 9, 20_001, dtype=torch.float64)
    log_q, log_p = log_density(x.unsqueeze(1), q), log_density(x.unsqueeze(1), p)
    return float(torch.trapezoid(log_q.exp() * (log_q - log_p), x))


def random_mixture(count: int, d: int) -> Gaussian:
    g = torch.Generator().manual_seed(count)
    mu, noise = (torch.randn(shape, generator=g).double() for shape in ((count, d), (count, d, d)))
    return Gaussian(mu, 0.3 * noise.tril(-1) + torch.eye(d).double())


def test_log_density_is_that_of_torch():
    q = random_mixture(3, 4)
    x = torch.randn(20, 4, generator=torch.Generator().manual_seed(9)).double()
    theirs = MixtureSameFamily(
        Categorical(torch.ones(3).double()), MultivariateNormal(q.mu, scale_tril=q.L)
    )
    torch.testing.assert_close(log_density(x, q), theirs.log_prob(x))


def test_sampled_kl_of_single_gaussians_is_the_closed_form():
    q, p = random_mixture(1, 3), kernels(torch.zeros(1, 3).double(), 0.8)
    estimate, error = monte_carlo_kl(q, p, 40_000, generator())
    exact = float(kl(Gaussian(q.mu[0], q.L[0]), Gaussian(p.mu[0], p.L[0])))
    assert 0 < error < 0.02
    assert abs(estimate - exact) < 4 * error


def test_kl_of_a_mixture_from_itself_is_zero_without_error():
    estimate, error = monte_carlo_kl(PRIOR, PRIOR, 100, generator())
    assert (estimate, error) == (0.0, 0.0)


@pytest.mark.parametrize("place", PLACES[::4])
def test_sampled_kl_agrees_with_quadrature(place):
    one = compare(place, generator())
    assert 0 < one.error < 0.05
    assert abs(one.estimate - quadrature_kl(posterior(place), PRIOR)) < 4 * one.error


@pytest.mark.parametrize("place", PLACES)
def test_bound_lies_above_the_kl(place):
    one = compare(place, generator())
    assert one.bound >= quadrature_kl(posterior(place), PRIOR)


@pytest.mark.parametrize("place", PLACES[::5])
def test_tables_obey_their_constraints(place):
    one = compare(place, generator())
    np.testing.assert_allclose(one.theta.sum(1), 1 / 2)
    np.testing.assert_allclose(one.phi.sum(0), 1 / 3)


def test_error_shrinks_with_the_root_of_the_samples():
    q = posterior(-1.0)
    few, many = (monte_carlo_kl(q, PRIOR, n, generator())[1] for n in (2_000, 32_000))
    assert many == pytest.approx(few / 4, rel=0.15)


def test_stated_error_is_the_spread_of_repeated_estimates():
    q, rng = posterior(0.5), generator()
    repeated = [monte_carlo_kl(q, PRIOR, 500, rng) for _ in range(200)]
    estimates, errors = np.array(repeated).T
    # the standard deviation of 200 draws is itself known to about 5 %
    assert errors.mean() == pytest.approx(estimates.std(ddof=1), rel=0.2)


def test_equal_seeds_give_equal_numbers():
    assert compare(0.0, generator()).estimate == compare(0.0, generator()).estimate
    assert compare(0.0, generator()).estimate != compare(0.0, np.random.default_rng(4)).estimate


def test_kernels_sit_on_the_sources():
    sources: Tensor = torch.randn(5, 3, generator=torch.Generator().manual_seed(0))
    prior = kernels(sources, 0.25)
    assert prior.mu is sources
    torch.testing.assert_close(prior.L, 0.5 * torch.eye(3).expand(5, 3, 3))


def test_picture_tells_bound_and_kl(monkeypatch):
    monkeypatch.setattr(mixture_kl, "SAMPLES", 100)
    rng = generator()
    places = [compare(place, rng) for place in (-1.0, 0.5)]
    html = bound_picture(places, 1)
    assert f"first component at 0.5: bound {places[1].bound:.2f}" in html
