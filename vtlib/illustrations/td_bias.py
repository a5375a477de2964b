"""Why the mean squared TD error overestimates the Bellman error (end of section 2.1.1)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vtlib.illustrations.bellman import MDP, optimal_operator, optimal_values
from vtlib.illustrations.picture import BLUE, GREEN, GREY, ORANGE, legend_below, picture

Sample = tuple[np.ndarray, np.ndarray, np.ndarray]


def squared_bellman_error(mdp: MDP, q: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """Mean (...) over nu (S, A) of the squared Bellman error of q (..., S, A), eq. 2.13, p = 2."""
    return np.asarray((nu * (optimal_operator(mdp, q) - q) ** 2).sum((-2, -1)))


def squared_td_error(mdp: MDP, q: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """Expectation (...) of eq. 2.14 with p = 2 for samples from nu (S, A), of q (..., S, A)."""
    value = q.max(-1)
    variance = mdp.expected_next(value**2) - mdp.expected_next(value) ** 2
    bias = (nu * mdp.gamma**2 * variance).sum((-2, -1))
    return np.asarray(squared_bellman_error(mdp, q, nu) + bias)


def draw_sample(mdp: MDP, nu: np.ndarray, count: int, rng: np.random.Generator) -> Sample:
    """States (N,) and actions (N,) from nu (S, A), and two next states (2, N) of each, eq. 2.14."""
    state, action = np.divmod(rng.choice(nu.size, count, p=nu.ravel()), nu.shape[1])
    ladder = mdp.transition[state, action].cumsum(1)
    after = (rng.random((2, count, 1)) > ladder).sum(-1)
    # The last step of the ladder is 1 up to rounding only, and a draw may lie above it.
    return state, action, np.minimum(after, len(nu) - 1)


def td_errors(mdp: MDP, sample: Sample, q: np.ndarray) -> np.ndarray:
    """TD errors (..., 2, N) of q (..., S, A), eq. 2.15, at both next states of a sample."""
    state, action, after = sample
    chosen = q[..., state, action][..., None, :]
    return np.asarray(mdp.reward[state, action] + mdp.gamma * q.max(-1)[..., after] - chosen)


def best_scale(chance: float, gamma: float) -> float:
    """The w that minimises the expectation of eq. 2.14 (p = 2) over Q = w Q*, for a coin."""
    return 1 / (1 + gamma**2 * chance * (1 - chance))


@picture(6.0, 3.7)
def bias_picture(figure: Figure, mdp: MDP, nu: np.ndarray, sample: Sample) -> str:
    """Both errors along Q = w Q* for a coin, and the TD errors of Q* where it is tossed.

    In state 0 of the MDP the coin leads to state 1, which pays 1, or to another, which pays none.
    """
    chance = float(mdp.transition[0, 0, 1])
    scale, deviation = best_scale(chance, mdp.gamma), mdp.gamma * (chance * (1 - chance)) ** 0.5
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    _draw_errors(left, mdp, nu, sample)
    left.axvline(scale, color=ORANGE, ls=":")
    legend_below(figure, left, 2)
    errors = mdp.gamma * np.array([1 - chance, -chance])
    right.bar(errors, [chance, 1 - chance], width=0.06, color=GREY)
    right.axvspan(-deviation, deviation, color=ORANGE, alpha=0.15, lw=0, label="±1 deviation")
    right.axvline(0, color=GREEN, ls="--", label="mean")
    right.set(xlabel="TD error $b_i$ of $Q^*$ at the coin", ylabel="probability")
    right.set(xlim=(-1, 1), ylim=(0, 1.35), yticks=np.linspace(0, 1, 5))
    right.set_title(f"mean of squares {deviation**2:.3f}\nsquare of mean 0", fontsize=9)
    right.legend(loc="upper left")
    return (
        f"Chance c = {chance:g}: the mean squared TD error is least at w = {scale:.2f}; the TD "
        f"errors of the true values have mean 0 and mean square {deviation**2:.3f} at the coin."
    )


def _draw_errors(ax: Axes, mdp: MDP, nu: np.ndarray, sample: Sample) -> None:
    """Expectations as curves over w, the gap between them shaded, and estimates as marks."""
    curve, marks = np.linspace(0, 1.4, 57), np.linspace(0, 1.4, 15)
    along, at = (w[:, None, None] * optimal_values(mdp) for w in (curve, marks))
    bellman, td = squared_bellman_error(mdp, along, nu), squared_td_error(mdp, along, nu)
    ax.fill_between(curve, bellman, td, color=ORANGE, alpha=0.15, lw=0, label="variance")
    ax.plot(curve, bellman, color=BLUE, label="squared Bellman error")
    ax.plot(curve, td, color=ORANGE, ls=(0, (5, 1.5)), label="mean squared TD error")
    errors = td_errors(mdp, sample, at)
    squares, products = (errors[:, 0] ** 2).mean(-1), errors.prod(1).mean(-1)
    ax.plot(marks, squares, "o", color=ORANGE, ms=4, label="estimate, one next state")
    ax.plot(marks, products, "x", color=BLUE, ms=5, label="estimate, two next states")
    ax.set(xlabel="$w$, where $Q_w = w\\,Q^*$", ylabel="error", xlim=(0, 1.4), ylim=(-0.03, 0.4))
