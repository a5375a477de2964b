"""Catoni's bound and the Gibbs posterior of a classifier with one threshold (section 2.3)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from vtlib.illustrations.palette import BLUE, GREEN, GREY, ORANGE, picture_html
from vtlib.plots import BookFigure, look


class Thresholds(NamedTuple):
    """Hypotheses: 1 where x is at least h (M,), with log prior probabilities (M,).

    Labels follow the threshold ``target`` and are flipped with probability ``flip``.
    """

    h: np.ndarray
    log_prior: np.ndarray
    target: float
    flip: float


def thresholds(count: int = 401) -> Thresholds:
    """Evenly spaced thresholds on [0, 1] with a prior around 0.35, while the target is 0.6."""
    h = np.linspace(0, 1, count)
    log_prior = -0.5 * ((h - 0.35) / 0.15) ** 2
    return Thresholds(h, log_prior - np.log(np.exp(log_prior).sum()), target=0.6, flip=0.1)


def draw_losses(problem: Thresholds, count: int, rng: np.random.Generator) -> np.ndarray:
    """Zero-one losses (count, M) of every hypothesis on independent samples, as in eq. 2.21."""
    x = rng.random(count)
    y = (x >= problem.target) ^ (rng.random(count) < problem.flip)
    wrong: np.ndarray = (x[:, None] >= problem.h) != y[:, None]
    return wrong.astype(np.float64)


def true_risk(problem: Thresholds) -> np.ndarray:
    """Generalisation error (M,) of every hypothesis, eq. 2.22 in closed form."""
    risk: np.ndarray = problem.flip + (1 - 2 * problem.flip) * np.abs(problem.h - problem.target)
    return risk


def gibbs_posterior(log_prior: np.ndarray, risk: np.ndarray, weight: float) -> np.ndarray:
    """Gibbs posterior probabilities (M,), eq. 2.23, from log prior and risk (M,), Lambda weight."""
    exponent = log_prior - weight * risk
    unnormalised = np.exp(exponent - exponent.max())
    probabilities: np.ndarray = unnormalised / unnormalised.sum()
    return probabilities


def kl(q: np.ndarray, p: np.ndarray) -> float:
    """KL(q || p) of probabilities (M,), eq. 2.17, with 0 log 0 = 0."""
    some = q > 0
    return float((q[some] * np.log(q[some] / p[some])).sum())


def catoni_bound(risk: float, divergence: float, count: int, beta: float, delta: float) -> float:
    """Right-hand side of Theorem 2.4 for a posterior's empirical risk and its KL to the prior."""
    exponent = beta * risk + (divergence - np.log(delta)) / count
    return float(np.expm1(-exponent) / np.expm1(-beta))


class Outcome(NamedTuple):
    """A Gibbs posterior (M,), its empirical and true mean risk, and Theorem 2.4's bound."""

    posterior: np.ndarray
    empirical: float
    true: float
    bound: float


def outcome(problem: Thresholds, losses: np.ndarray, lambda_: float, delta: float) -> Outcome:
    """What N losses (N, M) lead to by eq. 2.23 with Lambda = N / lambda, so beta = 1 / lambda."""
    count, risk = len(losses), losses.mean(0)
    q = gibbs_posterior(problem.log_prior, risk, count / lambda_)
    empirical = float(q @ risk)
    bound = catoni_bound(empirical, kl(q, np.exp(problem.log_prior)), count, 1 / lambda_, delta)
    return Outcome(q, empirical, float(q @ true_risk(problem)), bound)


def failures(
    problem: Thresholds,
    count: int,
    lambda_: float,
    delta: float,
    rng: np.random.Generator,
    sets: int = 1000,
) -> np.ndarray:
    """Whether Theorem 2.4's bound fails (sets,), for fresh sets of count samples each."""
    drawn = (draw_losses(problem, count, rng) for _ in range(sets))
    judged = (outcome(problem, losses, lambda_, delta) for losses in drawn)
    return np.array([one.true > one.bound for one in judged])


def gibbs_picture(
    problem: Thresholds,
    losses: np.ndarray,
    sizes: Sequence[int],
    count: int,
    lambda_: float,
    delta: float,
) -> str:
    """The Gibbs posterior of the first losses (N, M), and risks and bound along N, as HTML."""
    here = outcome(problem, losses[:count], lambda_, delta)
    with look():
        figure = BookFigure(figsize=(6.0, 3.5))
        grid = figure.add_gridspec(2, 2)
        above, below = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, 0])
        _draw_risks(above, problem, losses[:count])
        _draw_posterior(below, problem, here.posterior)
        _draw_bound(figure.add_subplot(grid[:, 1]), problem, losses, sizes, count, lambda_, delta)
    q = here.posterior
    mean = q @ problem.h
    deviation = np.sqrt(max(q @ problem.h**2 - mean**2, 0))
    return picture_html(
        figure,
        f"Gibbs posterior with N = {count} and lambda = {lambda_:g}: mean threshold {mean:.2f}, "
        f"deviation {deviation:.3f}; empirical risk {here.empirical:.2f}, true risk "
        f"{here.true:.2f}, bound {here.bound:.2f}.",
    )


def _draw_risks(ax: Axes, problem: Thresholds, losses: np.ndarray) -> None:
    ax.plot(problem.h, losses.mean(0), color=ORANGE, lw=1.2, label="empirical risk")
    ax.plot(problem.h, true_risk(problem), color=GREEN, ls="--", lw=1.4, label="true risk")
    ax.set(xlim=(0, 1), ylim=(0, 0.85), ylabel="risk")
    ax.tick_params(labelbottom=False)
    ax.legend(loc="upper right", fontsize=8)


def _draw_posterior(ax: Axes, problem: Thresholds, posterior: np.ndarray) -> None:
    """Densities on a logarithmic axis, where eq. 2.23 is a sum."""
    density = len(problem.h)
    prior = np.exp(problem.log_prior)
    ax.plot(problem.h, density * prior, ":", color=GREY, label="prior")
    ax.fill_between(problem.h, 1e-9, density * posterior + 1e-9, color=BLUE, alpha=0.25, lw=0)
    ax.plot(problem.h, density * posterior + 1e-9, color=BLUE, lw=1.4, label="Gibbs posterior")
    ax.set(xlim=(0, 1), yscale="log", ylim=(1e-3, 900), xlabel="threshold $h$", ylabel="density")
    ax.legend(loc="upper left", fontsize=8)


def _draw_bound(
    ax: Axes,
    problem: Thresholds,
    losses: np.ndarray,
    sizes: Sequence[int],
    count: int,
    lambda_: float,
    delta: float,
) -> None:
    along = [outcome(problem, losses[:n], lambda_, delta) for n in sizes]
    ax.plot(sizes, [one.bound for one in along], color=BLUE, label="Catoni's bound")
    ax.plot(sizes, [one.true for one in along], color=GREEN, ls="--", label="true risk")
    ax.plot(sizes, [one.empirical for one in along], color=ORANGE, lw=1.2, label="empirical risk")
    ax.axvline(count, ymax=0.8, color=GREY, lw=1, ls=":")
    here = outcome(problem, losses[:count], lambda_, delta)
    ax.plot([count] * 3, here[1:], "k.", ms=7, clip_on=False)
    ax.set(xscale="log", xlim=(sizes[0], sizes[-1]), ylim=(0, 1), xlabel="samples $N$")
    ax.set_ylabel(r"mean under $q^*$")
    ax.legend(loc="upper right", fontsize=8)
