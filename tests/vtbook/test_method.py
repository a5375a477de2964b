"""What chapter 5's page computes for its moving formulas, against closed forms and quadrature."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.distributions import MultivariateNormal

from vtlib.priors import Gaussian, kl

STARTS = torch.tensor([(0.3, -0.2), (-1.0, 0.7), (0.9, 1.4)], dtype=torch.float64)


@pytest.fixture(scope="module")
def method(cells_of) -> SimpleNamespace:
    """The names of the page."""
    return SimpleNamespace(**cells_of("method"))


# --- exact posteriors of the corridor ------------------------------------------------------------


def random_case(d: int, n: int, components: int) -> tuple[Gaussian, Tensor, Tensor]:
    g = torch.Generator().manual_seed(d)
    mu, x, r = (torch.randn(s, generator=g).double() for s in ((components, d), (n, d), (n,)))
    return Gaussian(mu, 1.5 * torch.eye(d).double()), x, r


def test_true_values_obey_the_bellman_equation_of_every_transition(method):
    at, x, r = method.walk(256, np.random.default_rng(1))
    ended, values = r > 0, method.value(at, method.TARGET_MUD)
    torch.testing.assert_close(values[:-1][~ended[:-1]], 0.9 * values[1:][~ended[:-1]])
    torch.testing.assert_close(values[ended], r[ended])
    w = torch.linalg.lstsq(method.bases, method.true).solution
    assert (r - x @ w).abs().max() < 0.02


def test_posterior_of_one_weight_by_quadrature(method):
    prior, x, r = random_case(1, 3, components=2)
    w = torch.linspace(-12, 12, 40_001, dtype=torch.float64)
    losses = (r.unsqueeze(1) - x * w).square().mean(0)
    covariance = prior.scale_tril @ prior.scale_tril.T
    bells = [MultivariateNormal(mu, covariance).log_prob(w.unsqueeze(1)).exp() for mu in prior.mu]
    density = sum(bells) * torch.exp(-len(r) / 0.7 * losses)
    density = density / torch.trapezoid(density, w)
    weights, mu, covariance = method.gibbs(prior, x, r, 0.7)
    moments = weights @ mu[:, 0], weights @ (mu[:, 0] ** 2 + covariance[0, 0])
    for power, ours in enumerate(moments, 1):
        torch.testing.assert_close(ours, torch.trapezoid(w**power * density, w))


def test_gradients_of_the_objective_vanish_at_the_posterior(method):
    # eq. 5.2 with a Gaussian family that contains the optimum: eqs. 5.8 to 5.11 must cancel there.
    n, lambda_ = 7, 0.4
    prior, x, r = random_case(5, n, components=1)
    _, mu, covariance = method.gibbs(prior, x, r, lambda_)
    q = Gaussian(mu[0].requires_grad_(), torch.linalg.cholesky(covariance).requires_grad_())
    of_kl = torch.autograd.grad(kl(q, Gaussian(prior.mu[0], prior.scale_tril)), q)
    # The squared TD errors are quadratic in w, so both expectations are known.
    td_mu = -2 / n * x.T @ (r - x @ q.mu)
    td_factor = (2 / n * x.T @ x @ q.scale_tril).tril()
    torch.testing.assert_close(td_mu, -lambda_ / n * of_kl[0])
    torch.testing.assert_close(td_factor, -lambda_ / n * of_kl[1].tril(), rtol=1e-6, atol=1e-9)


def test_the_drawn_posteriors_close_in_on_the_target(method):
    none, some, many = (method.posteriors(count) for count in (0, 16, 256))
    for name, prior in method.known.items():
        torch.testing.assert_close(none[name][1], prior.mu)
        errors = [method.mean_error(*found[name]) for found in (none, some, many)]
        assert errors[2] < errors[1] < 0.5 * errors[0]
    assert method.muds[some["MGVT"][0].argmax()] == 5.5  # the source nearest to the target


# --- mixed gradients -----------------------------------------------------------------------------


@pytest.mark.parametrize("psi", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("name", ["noisy", "shared"])
def test_direction_is_the_gradient_with_a_share_psi_through_the_target(method, name, psi):
    problem = getattr(method, name)

    def squared_error(w: Tensor, of_target: Tensor) -> Tensor:
        target = problem.reward + 0.9 * problem.x_next @ of_target
        return (target - problem.x @ w).square().mean()

    for w, ours in zip(STARTS, method.direction(problem, STARTS, psi), strict=True):
        at_state, at_next = torch.func.grad(squared_error, (0, 1))(w, w)
        torch.testing.assert_close(ours, at_state + psi * at_next)


@pytest.mark.parametrize("psi", [0.0, 0.5, 1.0])
def test_noise_biases_the_solution_where_descent_ends_as_in_closed_form(method, psi):
    second = 1 / (1 + psi * 0.9**2 / 4)
    closed = torch.tensor([0.9 / 2 * second, second], dtype=torch.float64)
    torch.testing.assert_close(method.solution(method.noisy, psi), closed)
    descent = method.descend(method.noisy, STARTS, psi)
    torch.testing.assert_close(descent[-1], closed.expand(3, 2))
    torch.testing.assert_close(method.solution(method.shared, psi), torch.zeros(2).double())


@pytest.mark.parametrize("psi", [0.0, 0.1, 0.2, 0.3, 0.5, 1.0])
def test_descent_grows_or_shrinks_as_the_eigenvalues_say(method, psi):
    shared = method.shared
    grows = bool(method.descend(shared, STARTS, psi)[-1].norm() > STARTS.norm())
    # The page says from where on descent converges: there the trace of the linear part vanishes.
    semi, full = (float(method.linear_part(shared, p)[0].trace()) for p in (0.0, 1.0))
    assert grows == (method.slowest_rate(shared, psi) < 0) == (psi < semi / (semi - full))


# --- divergences of Gaussians and mixtures -------------------------------------------------------


@pytest.mark.parametrize("shift", [0.0, 1.5])
@pytest.mark.parametrize("correlation", [-0.8, 0.3, 0.9])
def test_parts_are_the_terms_of_eq_5_7_and_pull_is_minus_eq_5_8(method, shift, correlation):
    q, p = method.planar(shift, correlation, 1.3), method.planar(0.0, 0.6, 1.0)
    covariance, prior = (one.scale_tril @ one.scale_tril.T for one in (q, p))
    volume, spread, apart = method.kl_parts(q, p)
    torch.testing.assert_close(volume, 0.5 * (torch.logdet(prior) - torch.logdet(covariance)))
    torch.testing.assert_close(spread, 0.5 * (torch.linalg.solve(prior, covariance).trace() - 2))
    torch.testing.assert_close(apart, 0.5 * q.mu @ torch.linalg.solve(prior, q.mu))
    torch.testing.assert_close(method.pull(q, p), -torch.linalg.solve(prior, q.mu))
    points = method.ellipse(q, 2.0)
    distance = torch.linalg.solve(q.scale_tril, (points - q.mu).T).norm(dim=0)
    torch.testing.assert_close(distance, torch.full_like(distance, 2.0))


def test_sampled_kl_agrees_with_quadrature_and_the_bound_lies_above(method):
    x = torch.linspace(-9, 9, 20_001, dtype=torch.float64).unsqueeze(-1)
    q, p = method.moved(method.places), method.prior_mixture
    log_q = q.log_prob(x)
    exact = torch.trapezoid(log_q.exp() * (log_q - p.log_prob(x)), x, dim=0)
    estimates, errors = method.sampled_kl(q, p, 4000, np.random.default_rng(3))
    standard = (estimates - exact) / errors
    assert standard.abs().max() < 4
    assert 0.5 < standard.std() < 1.5  # the stated errors are those made
    assert (method.bounds >= exact).all()


# --- two priors of the same sources --------------------------------------------------------------


@pytest.fixture
def sources() -> Tensor:
    """Twelve that differ by 3, 2 and a little along the first of six axes."""
    scale = torch.tensor([3.0, 2.0] + [0.05] * 4, dtype=torch.float64)
    return torch.randn(12, 6, generator=torch.Generator().manual_seed(5)).double() * scale + 1.0


def test_mass_is_the_density_times_the_area_of_small_cells(method, sources):
    x, y = (torch.linspace(-1, end, 201, dtype=torch.float64) for end in (1, 2))
    middles = [(edges[1:] + edges[:-1]) / 2 for edges in (x, y)]
    at = torch.stack(torch.meshgrid(*middles, indexing="xy"), -1)
    kernels = [MultivariateNormal(w, 0.64 * torch.eye(2).double()) for w in sources[:, :2]]
    density = torch.stack([kernel.log_prob(at).exp() for kernel in kernels]).mean(0)
    cells = method.mass(sources[:, :2], 0.8, x, y)
    torch.testing.assert_close(cells, density * 0.01 * 0.015, rtol=1e-3, atol=0)


def test_held_out_densities_use_only_the_others(method, sources):
    under_kernels, under_gaussian, eye = [], [], torch.eye(6).double()
    for k, w in enumerate(sources):
        rest = torch.cat([sources[:k], sources[k + 1 :]])
        each = torch.stack([MultivariateNormal(other, 0.49 * eye).log_prob(w) for other in rest])
        under_kernels.append(float(each.exp().mean().log()))
        covariance = torch.cov(rest.T, correction=0) + 1e-4 * eye
        under_gaussian.append(float(MultivariateNormal(rest.mean(0), covariance).log_prob(w)))
    assert method.held_out_kernels(sources, 0.7) == pytest.approx(sum(under_kernels) / 12)
    assert method.held_out_gaussian(sources) == pytest.approx(sum(under_gaussian) / 12)
