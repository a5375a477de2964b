"""The corridor and its exact posteriors: against quadrature, and the gradients of section 5.2."""

from __future__ import annotations

import numpy as np
import torch
from torch.distributions import MultivariateNormal

from vtlib.illustrations.collapse import GAMMA, TARGET_MUD, gibbs, value, walk
from vtlib.priors import Gaussian, kl


def random_case(d: int, n: int, components: int) -> tuple[Gaussian, torch.Tensor, torch.Tensor]:
    g = torch.Generator().manual_seed(d)
    mu, x, r = (torch.randn(s, generator=g).double() for s in ((components, d), (n, d), (n,)))
    return Gaussian(mu, 1.5 * torch.eye(d).double()), x, r


def test_true_values_obey_the_bellman_equation_of_every_transition(page):
    at, x, r = walk(256, np.random.default_rng(1))
    ended, values = r > 0, value(at, TARGET_MUD)
    torch.testing.assert_close(values[:-1][~ended[:-1]], GAMMA * values[1:][~ended[:-1]])
    torch.testing.assert_close(values[ended], r[ended])
    w = torch.linalg.lstsq(page("method")["bases"], page("method")["true"]).solution
    assert (r - x @ w).abs().max() < 0.02


def test_posterior_of_one_weight_by_quadrature():
    prior, x, r = random_case(1, 3, components=2)
    w = torch.linspace(-12, 12, 40_001, dtype=torch.float64)
    losses = (r.unsqueeze(1) - x * w).square().mean(0)
    covariance = prior.scale_tril @ prior.scale_tril.T
    bells = [MultivariateNormal(mu, covariance).log_prob(w.unsqueeze(1)).exp() for mu in prior.mu]
    density = sum(bells) * torch.exp(-len(r) / 0.7 * losses)
    density = density / torch.trapezoid(density, w)
    weights, mu, covariance = gibbs(prior, x, r, 0.7)
    moments = weights @ mu[:, 0], weights @ (mu[:, 0] ** 2 + covariance[0, 0])
    for power, ours in enumerate(moments, 1):
        torch.testing.assert_close(ours, torch.trapezoid(w**power * density, w))


def test_gradients_of_the_objective_vanish_at_the_posterior():
    # eq. 5.2 with a Gaussian family that contains the optimum: eqs. 5.8 to 5.11 must cancel there.
    n, lambda_ = 7, 0.4
    prior, x, r = random_case(5, n, components=1)
    _, mu, covariance = gibbs(prior, x, r, lambda_)
    q = Gaussian(mu[0].requires_grad_(), torch.linalg.cholesky(covariance).requires_grad_())
    of_kl = torch.autograd.grad(kl(q, Gaussian(prior.mu[0], prior.scale_tril)), q)
    # The squared TD errors are quadratic in w, so both expectations are known.
    td_mu = -2 / n * x.T @ (r - x @ q.mu)
    td_factor = (2 / n * x.T @ x @ q.scale_tril).tril()
    torch.testing.assert_close(td_mu, -lambda_ / n * of_kl[0])
    torch.testing.assert_close(td_factor, -lambda_ / n * of_kl[1].tril(), rtol=1e-6, atol=1e-9)


def test_the_drawn_posteriors_close_in_on_the_target(page):
    names = page("method")
    none, some, many = (names["posteriors"](count) for count in (0, 16, 256))
    for name, prior in names["known"].items():
        torch.testing.assert_close(none[name][1], prior.mu)
        errors = [names["mean_error"](*found[name]) for found in (none, some, many)]
        assert errors[2] < errors[1] < 0.5 * errors[0]
    assert names["muds"][some["MGVT"][0].argmax()] == 5.5  # the source nearest to the target
