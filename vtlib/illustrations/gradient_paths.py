"""Full, semi- and mixed gradients of the squared TD error on two problems of two states.

Each problem has one action, so that the mellowmax is the value itself and the TD errors are linear
in the weights: what is seen is the work of psi alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from matplotlib.axes import Axes
from torch import Tensor

from vtlib.mellow import td_cotangent
from vtlib.plots import BookFigure, image_html, look, small_png

PSIS = tuple(round(0.1 * k, 1) for k in range(11))
GAMMA = 0.9
OVERLAP = 1.9  # of the features in the second problem
STEP, STEPS, MARK = 0.1, 500, 50  # of the drawn descent: size, number, and one dot every MARK
PATHS, TRUE, REACHED = "#0072B2", "#1a1a1a", "#D55E00"


@dataclass(frozen=True)
class Problem:
    """Equally likely transitions: features (B, 2) of s and s', rewards (B,), terminal (B,)."""

    features: Tensor
    next_features: Tensor
    reward: Tensor
    terminal: Tensor
    truth: Tensor  # the weights (2,) of the true values


def noisy_problem() -> Problem:
    """Tabular: the first state ends or leads to the second by a toss; the second pays 1 and ends.

    The four transitions have the TD errors of eq. 2.15, with one weight per state.
    """
    states = torch.eye(2, dtype=torch.float64)
    return Problem(
        features=states[[0, 0, 1, 1]],
        next_features=states[[1, 1, 1, 1]],
        reward=torch.tensor([0.0, 0.0, 1.0, 1.0], dtype=torch.float64),
        terminal=torch.tensor([False, True, True, True]),
        truth=torch.tensor([GAMMA / 2, 1.0], dtype=torch.float64),
    )


def shared_problem() -> Problem:
    """Deterministic: both states lead to the second and pay nothing, and their features overlap.

    The two transitions have the TD errors of eq. 2.15; both vanish at weights zero.
    """
    second = (OVERLAP, (4 - OVERLAP**2) ** 0.5)
    features = torch.tensor([(1.0, 0.0), second], dtype=torch.float64)
    return Problem(
        features=features,
        next_features=features[[1, 1]],
        reward=torch.zeros(2, dtype=torch.float64),
        terminal=torch.tensor([False, False]),
        truth=torch.zeros(2, dtype=torch.float64),
    )


def direction(problem: Problem, w: Tensor, psi: float) -> Tensor:
    """The right-hand side (K, 2) of eq. 5.4 at weights w (K, 2), averaged over the transitions."""
    values, next_values = w @ problem.features.T, w @ problem.next_features.T
    at_state, at_next = td_cotangent(
        values.unsqueeze(-2),
        next_values.unsqueeze(-2),
        torch.zeros(len(problem.reward), dtype=torch.int64),
        problem.reward,
        problem.terminal,
        psi,
        GAMMA,
    )
    return (at_state @ problem.features + at_next @ problem.next_features).squeeze(-2)


def linear_part(problem: Problem, psi: float) -> tuple[Tensor, Tensor]:
    """A (2, 2) and c (2,) with A w + c the direction of eq. 5.4."""
    corners = torch.cat([torch.zeros(1, 2), torch.eye(2)]).double()
    at = direction(problem, corners, psi)
    return (at[1:] - at[0]).T, at[0]


def solution(problem: Problem, psi: float) -> Tensor:
    """The weights (2,) at which the direction of eq. 5.4 vanishes."""
    A, c = linear_part(problem, psi)
    w: Tensor = torch.linalg.solve(A, -c)
    return w


def slowest_rate(problem: Problem, psi: float) -> float:
    """Least real part of the eigenvalues of eq. 5.4's linear part; descent diverges below zero."""
    return float(torch.linalg.eigvals(linear_part(problem, psi)[0]).real.min())


def stable_from(problem: Problem) -> float:
    """The psi of eq. 5.4 at which descent ceases to diverge, by bisection to 1e-6; 0 if never."""
    low, high = 0.0, 1.0
    if slowest_rate(problem, low) > 0:
        return low
    while high - low > 1e-6:
        middle = (low + high) / 2
        low, high = (low, middle) if slowest_rate(problem, middle) > 0 else (middle, high)
    return high


def descend(problem: Problem, start: Tensor, psi: float, steps: int, step: float) -> Tensor:
    """Weights (steps + 1, K, 2) of gradient descent along eq. 5.4 from start (K, 2)."""
    path = [start]
    for _ in range(steps):
        path.append(path[-1] - step * direction(problem, path[-1], psi))
    return torch.stack(path)


def paths_picture(psi: float) -> str:
    """One psi as an HTML picture: descent along eq. 5.4 in the weight space of both problems."""
    noisy, shared = noisy_problem(), shared_problem()
    with look():
        figure = BookFigure(figsize=(6.5, 3.8))
        left, right = figure.subplots(1, 2)
        around = torch.tensor(
            [(-0.2, 0.4), (-0.2, 1.3), (0.4, 1.4), (1.1, 1.3), (1.1, 0.4), (0.4, 0.3)]
        )
        _draw(left, noisy, around.double(), psi)
        reached = torch.stack([solution(noisy, p) for p in PSIS])
        left.plot(*reached.T, color=REACHED, lw=1.2)
        left.set(xlim=(-0.25, 1.15), ylim=(0.25, 1.45), title="a toss of a coin")
        left.set(xlabel="weight 1: value of state 1", ylabel="weight 2: value of state 2")
        _draw(right, shared, 0.45 * _circle(6), psi)
        right.set(xlim=(-1.05, 1.05), ylim=(-1.05, 1.05), title="overlapping features")
        right.set(xlabel="weight 1", ylabel="weight 2")
        handles, labels = left.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
        figure.suptitle(f"ψ = {psi:g}", x=0.01, ha="left", fontsize=10)
    at = solution(noisy, psi).tolist()
    rate = slowest_rate(shared, psi)
    fate = f"shrink at rate {rate:.4f}" if rate > 0 else f"grow at rate {-rate:.4f}"
    alt = (
        f"psi = {psi:g}: with noise, descent ends at values {at[0]:.3f} and {at[1]:.3f} instead of "
        f"{GAMMA / 2:.3f} and 1; with overlapping features the weights {fate}."
    )
    return image_html(small_png(figure, 128), alt)


def _circle(points: int) -> Tensor:
    angle = 2 * torch.pi * torch.arange(points, dtype=torch.float64) / points + 0.3
    return torch.stack([angle.cos(), angle.sin()], -1)


def _draw(ax: Axes, problem: Problem, start: Tensor, psi: float) -> None:
    path = descend(problem, start, psi, STEPS, STEP)
    for line in path.unbind(1):
        ax.plot(*line.T, color=PATHS, lw=1.0)
        ax.plot(*line[::MARK].T, ".", color=PATHS, ms=4)
    ax.plot(*problem.truth, "*", color=TRUE, ms=13, label="true values", zorder=3)
    ax.plot(*solution(problem, psi), "D", color=REACHED, ms=6, label="direction is zero", zorder=4)
    ax.plot([], [], color=PATHS, marker=".", label=f"descent, a dot every {MARK} steps")
