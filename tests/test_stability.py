"""Stability of the descent on L: the bound by its recursion, the eigenvalue by a matrix."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.func import jacrev

from vtlib.factor import CholeskyFactors
from vtlib.gaussian import Precision
from vtlib.mellow import td_error
from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.stability import largest_step, steepest

D, SAMPLES = 8, 3


def recursion(u: np.ndarray, alpha_eta: float, samples: int) -> np.ndarray:
    """The matrix that takes E l_j^2 to its next value, for H = eta u u^T and |u| = 1."""
    c = np.cumsum(u[::-1] ** 2)[::-1]
    own = 1 - 2 * alpha_eta * c + (alpha_eta * c) ** 2 * (samples + 1) / samples
    return np.diag(own) + np.outer((alpha_eta * c) ** 2, np.ones(len(u))) / samples


def bound(u: np.ndarray, samples: int) -> float:
    length = (np.arange(1, len(u) + 1) * u**2).sum()
    return float(largest_step(torch.tensor(length), samples))


@pytest.mark.parametrize("where", ["first", "last", "all"])
def test_a_step_of_the_engine_follows_the_recursion(where):
    repeats, alpha, eta = 40_000, 0.1, 3.0
    u = {"first": np.eye(D)[0], "last": np.eye(D)[-1], "all": np.ones(D) / D**0.5}[where]
    along = torch.from_numpy(u).float()
    g = torch.Generator().manual_seed(5)
    start = torch.randn(D, D, generator=g).tril() + 3 * torch.eye(D)
    factors = CholeskyFactors(start.repeat(repeats, 1, 1), Precision(1.0), alpha, 1e-6, 1e12)
    noise = torch.randn(1, repeats, SAMPLES, D, generator=g)
    factors.look_ahead(noise)
    gradients = (factors.product(0) @ along).unsqueeze(-1) * (eta / SAMPLES) * along
    factors.step(gradients, noise[0], 0.0)
    squares = (along @ factors.L).square()
    expected = recursion(u, alpha * eta, SAMPLES) @ (along @ start).square().numpy()
    error = squares.std(0) / math.sqrt(repeats)
    assert (np.abs(squares.mean(0).numpy() - expected) < 5 * error.numpy() + 1e-5).all()


@settings(deadline=None)
@given(st.lists(st.floats(-1, 1), min_size=2, max_size=30), st.integers(1, 20))
def test_below_the_bound_the_factor_shrinks_along_any_direction(values, samples):
    u = np.array(values) + 1e-3
    u /= np.linalg.norm(u)
    matrix = recursion(u, 0.99 * bound(u, samples), samples)
    assert np.abs(np.linalg.eigvals(matrix)).max() < 1 + 1e-9


@pytest.mark.parametrize("samples", [1, 5, 10])
def test_above_the_bound_it_grows(samples):
    g = np.random.default_rng(6)
    last = np.zeros(200)
    last[-1] = 1
    for u, share in ((last, 1.01), (g.standard_normal(200), 1.3)):
        u = u / np.linalg.norm(u)
        matrix = recursion(u, share * bound(u, samples), samples)
        assert np.abs(np.linalg.eigvals(matrix)).max() > 1


def transitions(size: int) -> Transition:
    g = torch.Generator().manual_seed(3)
    return Transition(
        torch.randn(2, size, 3, generator=g),
        torch.randint(2, (2, size), generator=g),
        torch.randn(2, size, generator=g),
        torch.randn(2, size, 3, generator=g),
        torch.rand(2, size, generator=g) < 0.2,
    )


@pytest.mark.parametrize("psi", [0.0, 0.5, 1.0])
def test_the_eigenvalue_is_that_of_the_explicit_matrix(psi):
    q, batch = MLP((3, 5, 2)), transitions(40)
    mu = torch.randn(2, q.d, generator=torch.Generator().manual_seed(4))
    gamma, kappa = 0.9, 2.0

    def errors(w: torch.Tensor, frozen: torch.Tensor, r: int) -> torch.Tensor:
        """TD errors of run r with the next state's weights of their own."""
        now = q.q(w.view(1, 1, -1), q.prepare(batch.obs[r : r + 1]))
        after = q.q(frozen.view(1, 1, -1), q.prepare(batch.next_obs[r : r + 1]))
        rest = (x[r].view(1, 1, -1) for x in (batch.action, batch.reward, batch.terminal))
        return td_error(now, after, *rest, gamma=gamma, kappa=kappa).flatten()

    found, length = steepest(q, mu, batch, psi, gamma, kappa)
    for r in range(2):
        at_state = jacrev(errors, 0)(mu[r], mu[r], r)
        at_next = jacrev(errors, 1)(mu[r], mu[r], r)
        H = (2 / 40 * (at_state + psi * at_next).T @ (at_state + at_next)).double().numpy()
        values, right = np.linalg.eig(H)
        others, left = np.linalg.eig(H.T)
        top = np.abs(values).argmax()
        assert float(found[r]) == pytest.approx(abs(values[top]), rel=1e-3)
        both = right[:, top] * left[:, np.abs(others - values[top]).argmin()]
        expected = (np.arange(1, q.d + 1) * both / both.sum()).sum().real
        assert float(length[r]) == pytest.approx(expected, rel=1e-3)


def test_more_samples_allow_larger_steps_and_longer_rows_smaller_ones():
    length = torch.tensor([1.0, 50.0, 200.0])
    assert (largest_step(length, 5).diff() < 0).all()
    assert (largest_step(length, 10) > largest_step(length, 5)).all()
    assert float(largest_step(torch.tensor(1e-9), 10**6)) == pytest.approx(2, rel=1e-5)


@pytest.mark.parametrize("samples", [0, -1, 1.5])
def test_samples_that_are_no_count_are_refused(samples):
    with pytest.raises(ValueError, match="samples"):
        largest_step(torch.tensor([3.0]), samples)
