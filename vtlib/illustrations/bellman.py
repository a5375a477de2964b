"""The Bellman operators of a small MDP, and how they contract (section 2.1)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from vtlib.illustrations.palette import BLUE, GREEN, ORANGE, picture_html
from vtlib.plots import OPTIMUM, BookFigure, look

SHOWN = (1, 2, 4, 8, 16)  # applications after which the values are drawn


class MDP(NamedTuple):
    """A finite MDP: transition (S, A, S), reward (S, A), gamma (Definition 2.1)."""

    transition: np.ndarray
    reward: np.ndarray
    gamma: float


def corridor(cells: int, slip: float, gamma: float) -> MDP:
    """Cells in a row, then an end state: S = cells + 1 and A = 2, left and right.

    A move goes the other way with probability slip. Either action pays 1 in the last cell and leads
    to the end, where nothing is paid any more.
    """
    transition = np.zeros((cells + 1, 2, cells + 1))
    for s in range(cells - 1):
        left, right = max(s - 1, 0), s + 1
        for action, (meant, other) in enumerate(((left, right), (right, left))):
            transition[s, action, meant] += 1 - slip
            transition[s, action, other] += slip
    transition[cells - 1 :, :, cells] = 1
    reward = np.zeros((cells + 1, 2))
    reward[cells - 1] = 1
    return MDP(transition, reward, gamma)


def expected_next(mdp: MDP, v: np.ndarray) -> np.ndarray:
    """Expectation (..., S, A) of values v (..., S) of the next state."""
    mean: np.ndarray = np.einsum("ijk,...k->...ij", mdp.transition, v)
    return mean


def _backed_up(mdp: MDP, v: np.ndarray) -> np.ndarray:
    q: np.ndarray = mdp.reward + mdp.gamma * expected_next(mdp, v)
    return q


def policy_operator(mdp: MDP, policy: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Bellman operator of a policy (S,) applied to q (..., S, A), eq. 2.5."""
    followed = q[..., np.arange(len(policy)), policy]
    return _backed_up(mdp, followed)


def optimal_operator(mdp: MDP, q: np.ndarray) -> np.ndarray:
    """Optimal Bellman operator applied to q (..., S, A), eq. 2.9."""
    return _backed_up(mdp, q.max(-1))


def bellman_error(mdp: MDP, q: np.ndarray) -> np.ndarray:
    """Bellman error (..., S, A) of q (..., S, A): what the optimal operator would change."""
    error: np.ndarray = optimal_operator(mdp, q) - q
    return error


def policy_values(mdp: MDP, policy: np.ndarray) -> np.ndarray:
    """Action values (S, A) of a policy (S,), from the linear system that eq. 2.4 is."""
    states = np.arange(len(policy))
    step = mdp.transition[states, policy]
    v = np.linalg.solve(np.eye(len(policy)) - mdp.gamma * step, mdp.reward[states, policy])
    q: np.ndarray = mdp.reward + mdp.gamma * mdp.transition @ v
    return q


def optimal_values(mdp: MDP) -> np.ndarray:
    """Optimal action values (S, A), eq. 2.8, exact up to rounding by policy iteration."""
    states = np.arange(len(mdp.reward))
    policy = np.zeros(len(states), np.int64)
    while True:
        q = policy_values(mdp, policy)
        # ties keep their action, so that rounding cannot make the loop go on for ever
        better = q.max(1) > q[states, policy] + 1e-12
        if not better.any():
            return q
        policy = np.where(better, q.argmax(1), policy)


def iterates(mdp: MDP, q: np.ndarray, count: int) -> np.ndarray:
    """q (S, A) and what 1 to count applications of the optimal operator make of it, stacked."""
    kept = [q]
    for _ in range(count):
        kept.append(optimal_operator(mdp, kept[-1]))
    return np.stack(kept)


def sup_distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Largest difference (...) over all pairs of a and b (..., S, A), the norm of eq. 2.11."""
    largest: np.ndarray = np.abs(a - b).max((-2, -1))
    return largest


def applications_until(share: float, gamma: float) -> int:
    """Fewest applications k with gamma^k at most the given share, by eq. 2.11."""
    return int(np.ceil(np.log(share) / np.log(gamma) - 1e-9))


def contraction_picture(mdp: MDP, guess: np.ndarray, count: int = 40) -> str:
    """Values on the way to the fixed point, and distances to it from three starts, as HTML.

    guess (S, A) is the arbitrary one of the starts; the others are zero and the optimum plus 1.
    """
    best = optimal_values(mdp)
    starts = {"optimum + 1": best + 1, "arbitrary": guess, "zero": np.zeros_like(best)}
    paths = {name: iterates(mdp, start, count) for name, start in starts.items()}
    shares = {name: sup_distance(path, best) for name, path in paths.items()}
    shares = {name: distance / distance[0] for name, distance in shares.items()}
    with look():
        figure = BookFigure(figsize=(6.0, 3.3))
        left, right = figure.subplots(1, 2)
        _draw_values(left, paths["zero"], best)
        _draw_distances(right, shares, mdp.gamma)
        handles, labels = right.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
    told = ", ".join(f"{share[count]:.1e} from {name}" for name, share in shares.items())
    return picture_html(
        figure,
        f"Contraction with gamma = {mdp.gamma:g}. Left: values rise cell by cell from zero to the "
        f"optimum. Right: share of the first distance left after {count} applications: {told}; "
        f"the bound is {mdp.gamma**count:.1e}.",
    )


def _draw_values(ax: Axes, path: np.ndarray, best: np.ndarray) -> None:
    """Greedy values per cell after some applications, the end state left out."""
    cells = np.arange(1, len(best))
    for k in SHOWN:
        value = path[k, :-1].max(1)
        ax.plot(cells, value, ".-", color=BLUE, lw=1.3, ms=5)
        # the number stands under the furthest cell that the news of the goal has reached
        front = cells[np.flatnonzero(value)[0]]
        ax.annotate(f"{k}", (front, -0.04), ha="center", va="top", color=BLUE)
    ax.plot(cells, best[:-1].max(1), "--", color=OPTIMUM, lw=1.1)
    ax.set(xlabel="cell", ylabel=r"$\max_a\ Q_k(s, a)$", ylim=(-0.16, 1.1))


def _draw_distances(ax: Axes, shares: Mapping[str, np.ndarray], gamma: float) -> None:
    """Distances to the fixed point, as shares of the first, beside powers of gamma."""
    styles: dict[str, dict[str, Any]] = {
        "optimum + 1": {"color": ORANGE, "lw": 5, "alpha": 0.5},
        "arbitrary": {"color": GREEN, "ls": "-."},
        "zero": {"color": BLUE},
    }
    for name, share in shares.items():
        ax.plot(share, label=name, **styles[name])
    k = np.arange(len(shares["zero"]))
    ax.plot(k, gamma**k, "--", color=OPTIMUM, lw=1.1, label=r"bound $\gamma^k$")
    ax.set(xlabel="applications $k$", ylabel="distance over first distance", yscale="log")
    ax.set(xlim=(0, k[-1]), ylim=(1e-4, 1.6))
