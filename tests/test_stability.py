"""The largest curvature of the TD error: the eigenvalue of a matrix that is written down."""

import numpy as np
import pytest
import torch
from torch.func import jacrev

from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.stability import curvature
from vtlib.td import td_error


@pytest.mark.parametrize("psi", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("run", [0, 1])
def test_the_curvature_is_that_of_the_explicit_matrix_and_none_where_a_weight_is_none(psi, run):
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
    expected = np.abs(np.linalg.eigvals(H)).max()
    assert float(curvature(q, mu, batch, psi, gamma, kappa)[run]) == pytest.approx(expected)
    mu[run, 0] = torch.nan
    assert curvature(q, mu, batch, psi, gamma, kappa).isnan().tolist() == [run == 0, run == 1]
