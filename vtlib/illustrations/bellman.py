"""The Bellman operators of a small MDP, and how they contract (section 2.1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from vtlib.illustrations.picture import BLACK, BLUE, GREEN, ORANGE, legend_below, picture

COUNT = 40  # of the applications that are drawn


class MDP(NamedTuple):
    """A finite MDP: transition (S, A, S), reward (S, A), gamma (Definition 2.1)."""

    transition: np.ndarray
    reward: np.ndarray
    gamma: float

    def expected_next(self, v: np.ndarray) -> np.ndarray:
        """Expectation (..., S, A) of values v (..., S) of the next state."""
        return np.asarray(np.einsum("ijk,...k->...ij", self.transition, v))


def policy_operator(mdp: MDP, policy: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Bellman operator of a policy (S,) applied to q (..., S, A), eq. 2.5."""
    followed = q[..., np.arange(len(policy)), policy]
    return np.asarray(mdp.reward + mdp.gamma * mdp.expected_next(followed))


def optimal_operator(mdp: MDP, q: np.ndarray) -> np.ndarray:
    """Optimal Bellman operator applied to q (..., S, A), eq. 2.9."""
    return np.asarray(mdp.reward + mdp.gamma * mdp.expected_next(q.max(-1)))


def policy_values(mdp: MDP, policy: np.ndarray) -> np.ndarray:
    """Action values (S, A) of a policy (S,), from the linear system that eq. 2.4 is."""
    taken = np.arange(len(policy)), policy
    step = np.eye(len(policy)) - mdp.gamma * mdp.transition[taken]
    v = np.linalg.solve(step, mdp.reward[taken])
    return np.asarray(mdp.reward + mdp.gamma * mdp.expected_next(v))


def optimal_values(mdp: MDP) -> np.ndarray:
    """Optimal action values (S, A), eq. 2.8, up to rounding: the end of the way that is drawn."""
    q = np.zeros_like(mdp.reward)
    return np.asarray(iterates(mdp, q, applications_until(1e-17, mdp.gamma))[-1])


def iterates(mdp: MDP, q: np.ndarray, count: int) -> np.ndarray:
    """q (..., S, A) after 0 to count applications of the optimal operator, stacked."""
    kept = [q]
    for _ in range(count):
        kept.append(optimal_operator(mdp, kept[-1]))
    return np.stack(kept)


def sup_distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Largest difference (...) over all pairs of a and b (..., S, A), the norm of eq. 2.11."""
    return np.asarray(np.abs(a - b).max((-2, -1)))


def applications_until(share: float, gamma: float) -> int:
    """Fewest applications k with gamma^k at most the given share, by eq. 2.11."""
    return int(np.ceil(np.log(share) / np.log(gamma) - 1e-9))


@picture(6.0, 3.3)
def contraction_picture(figure: Figure, mdp: MDP, guess: np.ndarray) -> str:
    """Values of cells in a row and an end on the way to the optimum, and distances to it.

    The starts are guess (S, A), zero and the optimum plus 1.
    """
    best = optimal_values(mdp)
    paths = iterates(mdp, np.stack([best + 1, guess, np.zeros_like(best)]), COUNT)
    shares = sup_distance(paths, best) / sup_distance(paths[0], best)
    cells, bound = np.arange(1, len(best)), mdp.gamma ** np.arange(COUNT + 1)
    left, right = figure.subplots(1, 2)
    for k in (1, 2, 4, 8, 16):
        value = paths[k, 2, :-1].max(1)
        left.plot(cells, value, ".-", color=BLUE)
        # The number stands under the furthest cell that the news of the goal has reached.
        front = cells[np.flatnonzero(value)[0]]
        left.annotate(f"{k}", (front, -0.04), ha="center", va="top", color=BLUE)
    left.plot(cells, best[:-1].max(1), "--", color=BLACK)
    left.set(xlabel="cell", ylabel=r"$\max_a\ Q_k(s, a)$", ylim=(-0.16, 1.1))
    right.plot(shares[:, 0], color=ORANGE, lw=5, alpha=0.5, label="optimum + 1")
    right.plot(shares[:, 1], "-.", color=GREEN, label="arbitrary")
    right.plot(shares[:, 2], color=BLUE, label="zero")
    right.plot(bound, "--", color=BLACK, label=r"bound $\gamma^k$")
    right.set(xlabel="applications $k$", ylabel="distance over first distance", yscale="log")
    right.set(xlim=(0, COUNT), ylim=(1e-4, 1.6))
    legend_below(figure, right, 4)
    shift, arbitrary, zero = shares[-1]
    return (
        f"Contraction with gamma = {mdp.gamma:g}. Share of the first distance left after {COUNT} "
        f"applications: {shift:.1e} from optimum + 1, {arbitrary:.1e} from arbitrary, "
        f"{zero:.1e} from zero; the bound is {bound[-1]:.1e}."
    )
