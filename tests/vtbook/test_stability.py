"""Stability of the descent on L: the bound by its recursion, the eigenvalue by a matrix."""

import numpy as np
import pytest
import torch
from torch.func import jacrev

from vtbook.stability import largest_step, steepest
from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.stability import curvature
from vtlib.td import td_error


def recursion(u, alpha_eta, samples):
    """The matrix that takes E l_j^2 to its next value, for H = eta u u^T and |u| = 1."""
    c = np.cumsum(u[::-1] ** 2)[::-1]
    own = 1 - 2 * alpha_eta * c + (alpha_eta * c) ** 2 * (samples + 1) / samples
    return np.diag(own) + np.outer((alpha_eta * c) ** 2, np.ones(len(u))) / samples


def growth(u, share, samples):
    """By how much the factor grows in a step of a share of the bound along a direction."""
    u = u / np.linalg.norm(u)
    length = torch.tensor((np.arange(1, len(u) + 1) * u**2).sum())
    matrix = recursion(u, share * float(largest_step(length, samples)), samples)
    return float(np.abs(np.linalg.eigvals(matrix)).max())


@pytest.mark.parametrize("samples", [1, 5, 10])
def test_below_the_bound_the_factor_shrinks_along_any_direction_and_above_it_grows(samples):
    rng = np.random.default_rng(6)
    for size in (2, 3, 8, 30, 200):
        any_, last = rng.standard_normal(size), np.eye(size)[-1]
        for u in (any_, any_**3, np.eye(size)[0], last):
            assert growth(u, 0.99, samples) < 1 + 1e-9
    # the bound is sharp for rows of one length, and nearly so for others
    assert growth(last, 1.01, samples) > 1
    assert growth(any_, 1.3, samples) > 1


@pytest.mark.parametrize("psi", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("run", [0, 1])
def test_the_eigenvalue_is_that_of_the_explicit_matrix_and_none_where_a_weight_is_none(psi, run):
    q, g, gamma, kappa = MLP((3, 5, 2)), torch.Generator().manual_seed(3), 0.9, 2.0
    mu, obs, after = (torch.randn(2, *size, generator=g) for size in ((q.d,), (40, 3), (40, 3)))
    action, reward = torch.randint(2, (2, 40), generator=g), torch.randn(2, 40, generator=g)
    batch = Transition(obs, action, reward, after, torch.rand(2, 40, generator=g) < 0.2)

    def errors(w, following):
        """TD errors of the run with the next state's weights of their own."""
        now = q.q(w.view(1, 1, -1), q.prepare(obs[[run]]))
        later = q.q(following.view(1, 1, -1), q.prepare(after[[run]]))
        rest = (x[run].view(1, 1, -1) for x in (action, reward, batch.terminated))
        return td_error(now, later, *rest, gamma=gamma, kappa=kappa).flatten()

    at_state, at_next = jacrev(errors, (0, 1))(mu[run], mu[run])
    H = (2 / 40 * (at_state + psi * at_next).T @ (at_state + at_next)).double().numpy()
    values, right = np.linalg.eig(H)
    others, left = np.linalg.eig(H.T)
    top = np.abs(values).argmax()
    both = right[:, top] * left[:, np.abs(others - values[top]).argmin()]
    expected = (np.arange(1, q.d + 1) * both / both.sum()).sum().real
    eigenvalue, length = steepest(q, mu, batch, psi, gamma, kappa)
    assert float(eigenvalue[run]) == pytest.approx(abs(values[top]), rel=1e-3)
    assert float(curvature(q, mu, batch, psi, gamma, kappa)[run]) == pytest.approx(abs(values[top]))
    assert float(length[run]) == pytest.approx(expected, rel=1e-3)
    mu[run, 0] = torch.nan
    assert curvature(q, mu, batch, psi, gamma, kappa).isnan().tolist() == [run == 0, run == 1]
