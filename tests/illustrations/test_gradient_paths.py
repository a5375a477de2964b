"""Descent along the mixed gradient: where it ends, when it diverges, how fast it is."""

from __future__ import annotations

import pytest
import torch

from vtlib.illustrations.gradient_paths import (
    GAMMA,
    OVERLAP,
    PSIS,
    Problem,
    descend,
    direction,
    linear_part,
    noisy_problem,
    paths_picture,
    shared_problem,
    slowest_rate,
    solution,
    stable_from,
)

PROBLEMS = [noisy_problem(), shared_problem()]
STARTS = torch.tensor([(0.3, -0.2), (-1.0, 0.7), (0.9, 1.4)], dtype=torch.float64)


def mean_squared_error(problem: Problem, w: torch.Tensor) -> torch.Tensor:
    """Written out from eqs. 2.14 and 2.15, apart from the library."""
    alive = GAMMA * (~problem.terminal).double()
    errors = problem.reward + alive * (problem.next_features @ w) - problem.features @ w
    return errors.square().mean()


@pytest.mark.parametrize("problem", PROBLEMS)
def test_full_gradient_is_the_derivative_of_the_mean_squared_error(problem):
    ours = direction(problem, STARTS, 1.0)
    for w, row in zip(STARTS, ours, strict=True):
        theirs = torch.func.grad(lambda x: mean_squared_error(problem, x))(w)
        torch.testing.assert_close(row, theirs)


@pytest.mark.parametrize("problem", PROBLEMS)
def test_semi_gradient_holds_the_target(problem):
    alive = GAMMA * (~problem.terminal).double()
    for w, row in zip(STARTS, direction(problem, STARTS, 0.0), strict=True):
        target = problem.reward + alive * (problem.next_features @ w)
        theirs = -2 * (problem.features.T @ (target - problem.features @ w)) / len(target)
        torch.testing.assert_close(row, theirs)


@pytest.mark.parametrize("problem", PROBLEMS)
def test_direction_is_mixed_linearly_in_psi_and_affine_in_the_weights(problem):
    ends = direction(problem, STARTS, 0.0), direction(problem, STARTS, 1.0)
    mixed = direction(problem, STARTS, 0.3)
    torch.testing.assert_close(mixed, 0.7 * ends[0] + 0.3 * ends[1])
    A, c = linear_part(problem, 0.3)
    torch.testing.assert_close(mixed, STARTS @ A.T + c)


@pytest.mark.parametrize("psi", PSIS)
def test_noise_biases_the_solution_as_in_closed_form(psi):
    second = 1 / (1 + psi * GAMMA**2 / 4)
    closed = torch.tensor([GAMMA / 2 * second, second], dtype=torch.float64)
    torch.testing.assert_close(solution(noisy_problem(), psi), closed)
    if psi == 0:
        torch.testing.assert_close(closed, noisy_problem().truth)


def test_truth_is_the_expected_return():
    # state 2 pays 1 and ends; state 1 reaches it half of the time
    assert noisy_problem().truth.tolist() == [GAMMA / 2, 1.0]
    assert shared_problem().truth.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("psi", PSIS)
def test_without_noise_every_psi_has_the_true_solution(psi):
    torch.testing.assert_close(solution(shared_problem(), psi), torch.zeros(2).double())


def test_features_of_the_shared_problem():
    x = shared_problem().features
    assert float(x[0] @ x[1]) == pytest.approx(OVERLAP)
    assert float(x[1] @ x[1]) == pytest.approx(4.0)


@pytest.mark.parametrize("psi", [0.0, 0.1, 0.2, 0.3, 0.5, 1.0])
def test_descent_grows_or_shrinks_as_the_eigenvalues_say(psi):
    problem = shared_problem()
    path = descend(problem, STARTS, psi, 3000, 0.05)
    grows = path[-1].norm() > path[0].norm()
    assert bool(grows) == (slowest_rate(problem, psi) < 0) == (psi < stable_from(problem))


def test_half_the_full_gradient_is_the_quicker_stable_choice():
    problem = shared_problem()
    assert slowest_rate(problem, 0.5) > 10 * slowest_rate(problem, 1.0) > 0


def test_the_limit_of_stability_is_where_the_trace_vanishes():
    # complex eigenvalues there: their common real part is half the trace, which is affine in psi
    traces = [float(linear_part(shared_problem(), psi)[0].trace()) for psi in (0.0, 1.0)]
    assert stable_from(shared_problem()) == pytest.approx(
        traces[0] / (traces[0] - traces[1]), abs=1e-5
    )
    assert stable_from(noisy_problem()) == 0.0


def test_one_step_of_descent_is_against_the_direction():
    problem = noisy_problem()
    path = descend(problem, STARTS, 0.4, 2, 0.1)
    assert path.shape == (3, 3, 2)
    torch.testing.assert_close(path[1], STARTS - 0.1 * direction(problem, STARTS, 0.4))


def test_descent_ends_at_the_solution():
    problem = noisy_problem()
    end = descend(problem, STARTS, 1.0, 500, 0.1)[-1]
    torch.testing.assert_close(end, solution(problem, 1.0).expand(3, 2))


def test_picture_tells_divergence():
    assert "grow at rate 0.1550" in paths_picture(0.0)
    assert "shrink at rate" in paths_picture(0.3)
