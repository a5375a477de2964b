"""What chapter 5's page computes for its moving formulas, against closed forms and quadrature."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch.distributions import MultivariateNormal
from torch.testing import assert_close

from vtlib.priors import Gaussian

STARTS = torch.tensor([(0.3, -0.2), (-1.0, 0.7), (0.9, 1.4)], dtype=torch.float64)


@pytest.fixture(scope="module")
def method(cells_of):
    return SimpleNamespace(**cells_of("method"))


def draw(*shape, seed):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed)).double()


def test_true_values_obey_the_bellman_equation_of_every_transition(method):
    at, x, r = method.walk(256, np.random.default_rng(1))
    ended, values = r > 0, method.value(at, method.TARGET_MUD)
    assert_close(values[:-1][~ended[:-1]], 0.9 * values[1:][~ended[:-1]])
    assert_close(values[ended], r[ended])
    w = torch.linalg.lstsq(method.bases, method.true).solution
    assert (r - x @ w).abs().max() < 0.02


def test_posterior_of_two_weights_by_quadrature(method):
    mu, x, r = draw(2, 2, seed=1), draw(3, 2, seed=2), draw(3, seed=3)
    factor = torch.tensor([(1.5, 0.0), (0.6, 1.2)]).double()
    ends = torch.linspace(-12, 12, 601, dtype=torch.float64)
    w = torch.cartesian_prod(ends, ends)
    bells = [MultivariateNormal(one, scale_tril=factor).log_prob(w).exp() for one in mu]
    density = sum(bells) * torch.exp(-3 / 0.7 * (r - w @ x.T).square().mean(1))
    density = density / density.sum()
    weights, means, covariance = method.gibbs(Gaussian(mu, factor), x, r, 0.7)
    assert_close(weights @ means, density @ w)
    second = covariance + means.T @ (weights.unsqueeze(1) * means)
    assert_close(second, w.T @ (density.unsqueeze(1) * w))


@pytest.mark.parametrize("psi", [0.0, 0.3])
@pytest.mark.parametrize("name", ["noisy", "shared"])
def test_direction_is_the_gradient_with_a_share_psi_through_the_target(method, name, psi):
    problem = getattr(method, name)

    def squared_error(w, of_target):
        target = problem.reward + 0.9 * problem.x_next @ of_target
        return (target - problem.x @ w).square().mean()

    for w, ours in zip(STARTS, method.direction(problem, STARTS, psi), strict=True):
        at_state, at_next = torch.func.grad(squared_error, (0, 1))(w, w)
        assert_close(ours, at_state + psi * at_next)


@pytest.mark.parametrize("psi", [0.0, 0.5, 1.0])
def test_noise_biases_the_solution_where_descent_ends_as_in_closed_form(method, psi):
    second = 1 / (1 + psi * 0.9**2 / 4)
    closed = torch.tensor([0.9 / 2 * second, second], dtype=torch.float64)
    assert_close(method.solution(method.noisy, psi), closed)
    descent = method.descend(method.noisy, STARTS, psi)
    assert_close(descent[-1], closed.expand(3, 2))
    assert_close(method.solution(method.shared, psi), torch.zeros(2).double())
