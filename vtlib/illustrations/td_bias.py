"""Why the mean squared TD error overestimates the Bellman error (end of section 2.1.1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from vtlib.illustrations.bellman import MDP, bellman_error, expected_next, optimal_values
from vtlib.illustrations.palette import BLUE, GREEN, GREY, ORANGE, picture_html
from vtlib.plots import BookFigure, look

SCALES = np.linspace(0, 1.4, 57)
DOTS = np.linspace(0, 1.4, 15)


class Sample(NamedTuple):
    """Transitions (N,) of eq. 2.14, with a second, independent next state for each."""

    state: np.ndarray
    action: np.ndarray
    reward: np.ndarray
    after: np.ndarray
    other: np.ndarray


def fork(chance: float, gamma: float) -> MDP:
    """Four states, one action: a coin leads from state 0 to 1 with the given chance, else to 2.

    Only state 1 pays, 1; from states 1 and 2 the way goes to the end, state 3.
    """
    transition = np.zeros((4, 1, 4))
    transition[0, 0, 1:3] = chance, 1 - chance
    transition[1:, 0, 3] = 1
    reward = np.array([[0.0], [1.0], [0.0], [0.0]])
    return MDP(transition, reward, gamma)


def uniform_but_last(mdp: MDP) -> np.ndarray:
    """Measure nu (S, A) of eq. 2.13: equal weights, and none on the last state, the end."""
    nu = np.ones_like(mdp.reward)
    nu[-1] = 0
    weights: np.ndarray = nu / nu.sum()
    return weights


def squared_bellman_error(mdp: MDP, q: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """Mean (...) over nu (S, A) of the squared Bellman error of q (..., S, A), eq. 2.13, p = 2."""
    mean: np.ndarray = (nu * bellman_error(mdp, q) ** 2).sum((-2, -1))
    return mean


def target_variance(mdp: MDP, q: np.ndarray) -> np.ndarray:
    """Variance (..., S, A) of the TD error (eq. 2.15) at each pair, over the next state."""
    value = q.max(-1)
    mean, square = expected_next(mdp, value), expected_next(mdp, value**2)
    variance: np.ndarray = mdp.gamma**2 * (square - mean**2)
    return variance


def squared_td_error(mdp: MDP, q: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """Expectation (...) of eq. 2.14 with p = 2 for samples from nu (S, A), of q (..., S, A)."""
    bias: np.ndarray = (nu * target_variance(mdp, q)).sum((-2, -1))
    mean: np.ndarray = squared_bellman_error(mdp, q, nu) + bias
    return mean


def draw_sample(mdp: MDP, nu: np.ndarray, count: int, rng: np.random.Generator) -> Sample:
    """Independent transitions (count,) with pairs from nu (S, A), as in eq. 2.14."""
    pair = rng.choice(nu.size, count, p=nu.ravel())
    state, action = np.divmod(pair, nu.shape[1])
    ladder = mdp.transition[state, action].cumsum(1)
    # inverse of the distribution function; the last step is 1 up to rounding, hence the bound
    after, other = (
        np.minimum((rng.random((count, 1)) > ladder).sum(1), nu.shape[0] - 1) for _ in range(2)
    )
    return Sample(state, action, mdp.reward[state, action], after, other)


def td_errors(sample: Sample, q: np.ndarray, gamma: float, other: bool = False) -> np.ndarray:
    """TD errors (..., N) of q (..., S, A), eq. 2.15, at the first or the other next states."""
    after = sample.other if other else sample.after
    target = sample.reward + gamma * q.max(-1)[..., after]
    errors: np.ndarray = target - q[..., sample.state, sample.action]
    return errors


def best_scale(chance: float, gamma: float) -> float:
    """The w that minimises the expectation of eq. 2.14 (p = 2) over Q = w Q* in the fork."""
    return 1 / (1 + gamma**2 * chance * (1 - chance))


def bias_picture(chance: float, gamma: float, count: int, rng: np.random.Generator) -> str:
    """Both errors along Q = w Q* in the fork, and the TD errors of Q* at the coin, as HTML."""
    mdp = fork(chance, gamma)
    nu, best = uniform_but_last(mdp), optimal_values(mdp)
    sample = draw_sample(mdp, nu, count, rng)
    with look():
        figure = BookFigure(figsize=(6.0, 3.7))
        left, right = figure.subplots(1, 2, width_ratios=(3, 2))
        _draw_errors(left, mdp, nu, best, sample)
        left.axvline(best_scale(chance, gamma), color=ORANGE, ls=":", lw=1.2)
        _draw_coin(right, chance, gamma)
        handles, labels = left.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2)
    variance = gamma**2 * chance * (1 - chance)
    return picture_html(
        figure,
        f"Chance c = {chance:g}. Left: the squared Bellman error is zero at w = 1, the mean "
        f"squared TD error is least at w = {best_scale(chance, gamma):.2f}. Right: at the coin "
        f"the TD errors of the true values have mean 0 and mean square {variance:.3f}.",
    )


def _draw_errors(ax: Axes, mdp: MDP, nu: np.ndarray, best: np.ndarray, sample: Sample) -> None:
    """Expectations as curves over w, the gap between them shaded, and estimates as marks."""
    q = SCALES[:, None, None] * best
    bellman, td = squared_bellman_error(mdp, q, nu), squared_td_error(mdp, q, nu)
    ax.fill_between(SCALES, bellman, td, color=ORANGE, alpha=0.15, lw=0, label="variance")
    ax.plot(SCALES, bellman, color=BLUE, label="squared Bellman error")
    ax.plot(SCALES, td, color=ORANGE, ls=(0, (5, 1.5)), label="mean squared TD error")
    q = DOTS[:, None, None] * best
    first, second = (td_errors(sample, q, mdp.gamma, other) for other in (False, True))
    ax.plot(DOTS, (first**2).mean(1), "o", color=ORANGE, ms=4, label="estimate, one next state")
    product = (first * second).mean(1)
    ax.plot(DOTS, product, "x", color=BLUE, ms=5, label="estimate, two next states")
    ax.set(xlabel="$w$, where $Q_w = w\\,Q^*$", ylabel="error", xlim=(0, 1.4), ylim=(-0.03, 0.4))


def _draw_coin(ax: Axes, chance: float, gamma: float) -> None:
    """The two TD errors of Q* at the coin, with their probabilities, mean and deviation."""
    errors = gamma * np.array([1 - chance, -chance])
    ax.bar(errors, [chance, 1 - chance], width=0.06, color=GREY)
    deviation = gamma * np.sqrt(chance * (1 - chance))
    ax.axvspan(-deviation, deviation, color=ORANGE, alpha=0.15, lw=0, label="±1 deviation")
    ax.axvline(0, color=GREEN, lw=1.4, ls="--", label="mean")
    ax.set(xlabel="TD error $b_i$ of $Q^*$ at the coin", ylabel="probability")
    ax.set(xlim=(-1, 1), ylim=(0, 1.35), yticks=np.linspace(0, 1, 5))
    ax.set_title(f"mean of squares {deviation**2:.3f}\nsquare of mean 0", fontsize=9)
    ax.legend(loc="upper left", fontsize=8)
