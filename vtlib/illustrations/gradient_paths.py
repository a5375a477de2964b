"""Full, semi- and mixed gradients of the squared TD error, in the space of two weights.

There is one action, so that the mellowmax is the value itself and TD errors are linear.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from matplotlib.axes import Axes
from torch import Tensor

from vtlib.illustrations.picture import BLACK, BLUE, ORANGE
from vtlib.td import td_cotangent

GAMMA = 0.9
STEP, STEPS, MARK = 0.1, 500, 50  # of the drawn descent: size, number, and one dot every MARK


class Problem(NamedTuple):
    """Equally likely transitions: features x, x_next (B, 2), zero at an end, and rewards (B,)."""

    x: Tensor
    x_next: Tensor
    reward: Tensor


def direction(problem: Problem, w: Tensor, psi: float) -> Tensor:
    """The right-hand side (K, 2) of eq. 5.4 at weights w (K, 2), averaged over the transitions."""
    q, q_next = ((w @ x.T).unsqueeze(-2) for x in problem[:2])
    zeros = torch.zeros(len(problem.reward), dtype=torch.int64)
    at_state, at_next = td_cotangent(q, q_next, zeros, problem.reward, zeros.bool(), psi, GAMMA)
    return (at_state @ problem.x + at_next @ problem.x_next).squeeze(-2)


def linear_part(problem: Problem, psi: float) -> tuple[Tensor, Tensor]:
    """A (2, 2) and c (2,) with A w + c the direction of eq. 5.4."""
    c, *columns = direction(problem, torch.eye(3, 2, dtype=torch.float64).roll(1, 0), psi)
    return torch.stack(columns, -1) - c.unsqueeze(-1), c


def solution(problem: Problem, psi: float) -> Tensor:
    """The weights (2,) at which the direction of eq. 5.4 vanishes."""
    A, c = linear_part(problem, psi)
    w: Tensor = torch.linalg.solve(A, -c)
    return w


def slowest_rate(problem: Problem, psi: float) -> float:
    """Least real part of the eigenvalues of eq. 5.4's linear part; descent diverges below zero."""
    return float(torch.linalg.eigvals(linear_part(problem, psi)[0]).real.min())


def descend(problem: Problem, start: Tensor, psi: float) -> Tensor:
    """Weights (STEPS + 1, K, 2) of gradient descent along eq. 5.4 from start (K, 2)."""
    path = [start]
    for _ in range(STEPS):
        path.append(path[-1] - STEP * direction(problem, path[-1], psi))
    return torch.stack(path)


def draw_descent(ax: Axes, problem: Problem, start: Tensor, psi: float) -> None:
    """Descent along eq. 5.4 from start (K, 2), where it ends, and the true values."""
    for line in descend(problem, start, psi).unbind(1):
        ax.plot(*line.T, color=BLUE, lw=1.0)
        ax.plot(*line[::MARK].T, ".", color=BLUE, ms=4)
    # In both problems weights can represent the true values, which the semi-gradient then finds.
    ax.plot(*solution(problem, 0.0), "*", color=BLACK, ms=13, label="true values", zorder=3)
    ax.plot(*solution(problem, psi), "D", color=ORANGE, ms=6, label="direction is zero", zorder=4)
    ax.plot([], [], color=BLUE, marker=".", label=f"descent, a dot every {MARK} steps")
