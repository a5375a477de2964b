"""Descent along the mixed gradient: where it ends, when it diverges, how fast it is."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from vtlib.illustrations import gradient_paths as paths

STARTS = torch.tensor([(0.3, -0.2), (-1.0, 0.7), (0.9, 1.4)], dtype=torch.float64)


@pytest.mark.parametrize("psi", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("name", ["noisy", "shared"])
def test_direction_is_the_gradient_with_a_share_psi_through_the_target(page, name: str, psi: float):
    problem = page("method")[name]

    def squared_error(w: Tensor, of_target: Tensor) -> Tensor:
        target = problem.reward + paths.GAMMA * problem.x_next @ of_target
        return (target - problem.x @ w).square().mean()

    for w, ours in zip(STARTS, paths.direction(problem, STARTS, psi), strict=True):
        at_state, at_next = torch.func.grad(squared_error, (0, 1))(w, w)
        torch.testing.assert_close(ours, at_state + psi * at_next)


@pytest.mark.parametrize("psi", [0.0, 0.5, 1.0])
def test_noise_biases_the_solution_where_descent_ends_as_in_closed_form(page, psi: float):
    noisy, shared = page("method")["noisy"], page("method")["shared"]
    second = 1 / (1 + psi * paths.GAMMA**2 / 4)
    closed = torch.tensor([paths.GAMMA / 2 * second, second], dtype=torch.float64)
    torch.testing.assert_close(paths.solution(noisy, psi), closed)
    torch.testing.assert_close(paths.descend(noisy, STARTS, psi)[-1], closed.expand(3, 2))
    torch.testing.assert_close(paths.solution(shared, psi), torch.zeros(2).double())


@pytest.mark.parametrize("psi", [0.0, 0.1, 0.2, 0.3, 0.5, 1.0])
def test_descent_grows_or_shrinks_as_the_eigenvalues_say(page, psi: float):
    shared = page("method")["shared"]
    grows = bool(paths.descend(shared, STARTS, psi)[-1].norm() > STARTS.norm())
    # The page says from where on descent converges: there the trace of the linear part vanishes.
    semi, full = (float(paths.linear_part(shared, p)[0].trace()) for p in (0.0, 1.0))
    assert grows == (paths.slowest_rate(shared, psi) < 0) == (psi < semi / (semi - full))
