"""The bound on the KL of two mixtures, against Monte Carlo, autograd and its own properties."""

from __future__ import annotations

import itertools
import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.distributions import Categorical, MixtureSameFamily, MultivariateNormal

from vtlib.gaussian import Gaussian, kl
from vtlib.mixture import (
    kl_bound,
    pairwise_kl,
    pull_of_sources,
    responsibilities,
    squared_distances,
)

CASES = [(1, 1), (1, 4), (2, 1), (2, 3), (3, 3), (4, 2)]


def draw(*shape: int, seed: int = 0) -> Tensor:
    g = torch.Generator().manual_seed(seed)
    return torch.randn(shape, dtype=torch.float64, generator=g)


def posterior(components: int, d: int, seed: int = 1) -> Gaussian:
    lower = 0.3 * draw(components, d, d, seed=seed).tril(-1)
    diagonal = draw(components, d, seed=seed + 1).mul(0.2).exp()
    return Gaussian(draw(components, d, seed=seed + 2), lower + torch.diag_embed(diagonal))


def tight_bound(pairwise: Tensor, updates: int | None = None) -> Tensor:
    return kl_bound(pairwise, *responsibilities(pairwise, updates))


def torch_mixture(mu: Tensor, L: Tensor) -> MixtureSameFamily:
    weights = Categorical(torch.ones(len(mu), dtype=torch.float64))
    return MixtureSameFamily(weights, MultivariateNormal(mu, scale_tril=L))


@pytest.mark.parametrize(("components", "sources"), CASES)
@pytest.mark.parametrize("d", [1, 3])
def test_bound_is_at_least_the_monte_carlo_kl(components, sources, d):
    variance, samples = 0.7, 100_000
    q, w = posterior(components, d), draw(sources, d, seed=8)
    with torch.random.fork_rng():
        # torch.distributions draw from the global generator alone; the fork gives it back
        torch.manual_seed(0)
        x = torch_mixture(*q).sample((samples,))
    factor = variance**0.5 * torch.eye(d, dtype=torch.float64).expand(sources, d, d)
    ratio = torch_mixture(*q).log_prob(x) - torch_mixture(w, factor).log_prob(x)
    error = ratio.std() / samples**0.5
    assert error < 0.05
    bound = tight_bound(pairwise_kl(q, w, variance))
    assert bound >= ratio.mean() - 4 * error
    if components == sources == 1:
        assert (bound - ratio.mean()).abs() <= 4 * error


def test_bound_is_exact_for_single_gaussians():
    q, w = posterior(1, 5), draw(1, 5, seed=8)
    prior = Gaussian(w, 0.3**0.5 * torch.eye(5, dtype=torch.float64))
    torch.testing.assert_close(tight_bound(pairwise_kl(q, w, 0.3)), kl(q, prior)[0])


def test_bound_of_equal_mixtures_far_apart_is_zero():
    w = 100 * draw(4, 3)
    q = Gaussian(w, 0.1 * torch.eye(3, dtype=torch.float64).expand(4, 3, 3))
    assert tight_bound(pairwise_kl(q, w, 0.01)).item() == pytest.approx(0.0, abs=1e-9)


def test_pairwise_kl_is_a_table_of_closed_forms():
    q, w = posterior(3, 4), draw(2, 4, seed=8)
    table = pairwise_kl(q, w, 0.3)
    eye = 0.3**0.5 * torch.eye(4, dtype=torch.float64)
    for i in range(3):
        for j in range(2):
            torch.testing.assert_close(
                table[i, j], kl(Gaussian(q.mu[i], q.L[i]), Gaussian(w[j], eye))
            )
    torch.testing.assert_close(squared_distances(q.mu, w)[2, 1], (q.mu[2] - w[1]).square().sum())


@settings(deadline=None, derandomize=True, max_examples=60)
@given(st.integers(1, 5), st.integers(1, 6), st.floats(0.01, 1e4), st.integers(0, 1000))
def test_bound_never_rises_under_updates(components, sources, scale, seed):
    pairwise = scale * draw(components, sources, seed=seed).square()
    bounds = [tight_bound(pairwise, k).item() for k in range(25)]
    slack = 1e-12 * (1 + abs(bounds[0]))
    assert all(later <= sooner + slack for sooner, later in itertools.pairwise(bounds))
    assert tight_bound(pairwise).item() <= bounds[1] + slack


@settings(deadline=None, derandomize=True, max_examples=60)
@given(st.integers(1, 5), st.integers(1, 6), st.floats(0.01, 1e4), st.integers(0, 1000))
def test_marginals_of_theta_and_phi(components, sources, scale, seed):
    pairwise = scale * draw(components, sources, seed=seed).square()
    for updates in (0, 1, 7, None):
        theta, phi = (x.exp() for x in responsibilities(pairwise, updates))
        per_component = torch.full((components,), 1 / components, dtype=torch.float64)
        per_source = torch.full((sources,), 1 / sources, dtype=torch.float64)
        torch.testing.assert_close(theta.sum(1), per_component)
        torch.testing.assert_close(phi.sum(0), per_source)


def test_one_update_is_equations_5_14_and_5_15():
    pairwise = draw(3, 4).square()
    theta_before = responsibilities(pairwise, 6)[0].exp()
    theta, phi = (x.exp() for x in responsibilities(pairwise, 7))
    torch.testing.assert_close(phi, theta_before / theta_before.sum(0) / 4)
    boltzmann = phi * (-pairwise).exp()
    torch.testing.assert_close(theta, boltzmann / boltzmann.sum(1, keepdim=True) / 3)


def test_converged_bound_is_near_its_limit():
    for seed in range(5):
        pairwise = 3 * draw(3, 6, seed=seed).square()
        limit = tight_bound(pairwise, 1000)
        assert limit - 1e-9 <= tight_bound(pairwise) <= limit + 0.02


def test_permutations_change_nothing():
    pairwise = 4 * draw(3, 5).square()
    rows, columns = torch.tensor([2, 0, 1]), torch.tensor([4, 1, 0, 3, 2])
    moved = pairwise[rows][:, columns]
    torch.testing.assert_close(tight_bound(moved), tight_bound(pairwise))
    for ours, theirs in zip(responsibilities(moved), responsibilities(pairwise), strict=True):
        torch.testing.assert_close(ours.exp(), theirs[rows][:, columns].exp())
    mu, w = draw(3, 4), draw(5, 4, seed=2)
    pull = pull_of_sources(mu, w, 0.5)
    torch.testing.assert_close(pull_of_sources(mu[rows], w[columns], 0.5), pull[rows])


@pytest.mark.parametrize("components", [1, 3])
@pytest.mark.parametrize("start", ["on sources", "mean", "apart"])
def test_far_sources_in_484_dimensions_stay_finite(components, start):
    d, variance = 484, 1e-5
    g = torch.Generator().manual_seed(0)
    w = 0.2 * torch.randn(10, d, generator=g)
    mu = {
        "on sources": w[:components].clone(),
        "mean": w.mean(0).expand(components, d).clone(),
        "apart": 0.2 * torch.randn(components, d, generator=g),
    }[start]
    q = Gaussian(mu, variance**0.5 * torch.eye(d).expand(components, d, d))
    pairwise = pairwise_kl(q, w, variance)
    assert 1e5 < pairwise.max() < 1e7
    log_theta, log_phi = responsibilities(pairwise)
    bound = kl_bound(pairwise, log_theta, log_phi)
    assert torch.isfinite(bound)
    assert torch.isfinite(pull_of_sources(mu, w, variance)).all()
    shares = torch.full((components,), 1 / components).double()
    torch.testing.assert_close(log_theta.exp().sum(1).double(), shares)
    torch.testing.assert_close(log_phi.exp().sum(0).double(), torch.full((10,), 0.1).double())
    if start == "on sources":
        # each component explains its own source: log S - log C is what remains
        assert bound.item() == pytest.approx(math.log(10 / components), abs=1e-2)


@pytest.mark.parametrize("components", [1, 2, 3])
def test_pull_vanishes_exactly_on_far_sources(components):
    # Adam divides by the gradient's size: a mere rounding error would move the means
    w = torch.randn(10, 484, generator=torch.Generator().manual_seed(0))
    assert not pull_of_sources(w[:components].clone(), w, 1e-5).any()


@pytest.mark.parametrize(("components", "sources"), CASES)
def test_pull_is_the_gradient_of_the_tightened_bound(components, sources):
    q, w, variance = posterior(components, 4), draw(sources, 4, seed=8), 0.9
    ours = pull_of_sources(q.mu, w, variance)
    mu = q.mu.clone().requires_grad_()
    log_theta, log_phi = responsibilities(pairwise_kl(q, w, variance))
    held = kl_bound(pairwise_kl(Gaussian(mu, q.L), w, variance), log_theta, log_phi)
    (with_theta_held,) = torch.autograd.grad(held, mu)
    torch.testing.assert_close(ours, with_theta_held, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(("components", "sources"), CASES)
def test_pull_agrees_with_finite_differences(components, sources):
    # theta and phi are tightened anew at either end: at their fixed point the bound is flat in them
    q, w, variance, h = posterior(components, 3), draw(sources, 3, seed=8), 0.9, 1e-3
    mu = 2.5 * q.mu
    steps = h * torch.eye(mu.numel(), dtype=torch.float64).view(-1, *mu.shape)
    ends = torch.stack([mu + steps, mu - steps])
    above, below = tight_bound(pairwise_kl(Gaussian(ends, q.L), w, variance), 1000)
    slopes = ((above - below) / (2 * h)).view_as(mu)
    torch.testing.assert_close(pull_of_sources(mu, w, variance), slopes, rtol=0, atol=0.01)


def test_runs_of_a_batch_do_not_feel_each_other():
    quick = 50 * draw(3, 5, seed=1).square()
    slow = 0.05 * draw(3, 5, seed=2).square()
    both = torch.stack([quick, slow, 3 * quick])
    for r in range(3):
        for ours, alone in zip(responsibilities(both), responsibilities(both[r]), strict=True):
            torch.testing.assert_close(ours[r].exp(), alone.exp(), rtol=0, atol=1e-5)
