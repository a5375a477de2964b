"""Evidence, ELBO and Kullback-Leibler divergence of a posterior on a line (section 2.2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from vtlib.illustrations.palette import BLUE, GREY, ORANGE, picture_html
from vtlib.plots import OPTIMUM, BookFigure, look

MEANS = np.linspace(-2.4, 2.4, 121)
DEEPEST = -14.0  # of the drawn ELBO, in nats


class Problem(NamedTuple):
    """Prior and likelihood of eq. 2.16 in logarithms, (G,) each, on an even grid y (G,)."""

    y: np.ndarray
    log_prior: np.ndarray
    log_likelihood: np.ndarray


def normal_log_density(y: np.ndarray, mean: float, deviation: float) -> np.ndarray:
    """Logarithm (G,) of the Gaussian density at y (G,): q_xi of eq. 2.18 and its prior."""
    square = ((y - mean) / deviation) ** 2
    logs: np.ndarray = -0.5 * square - np.log(deviation) - 0.5 * np.log(2 * np.pi)
    return logs


def square_problem(observed: float = 2.0, noise: float = 0.7) -> Problem:
    """A problem of eq. 2.16 on a grid (2801,): the square of y is observed, its sign is lost.

    The prior N(0.5, 1.5^2) leans to the right.
    """
    y = np.linspace(-7, 7, 2801)
    prior = normal_log_density(y, 0.5, 1.5)
    return Problem(y, prior, normal_log_density(y**2, observed, noise))


def integral(y: np.ndarray, values: np.ndarray) -> float:
    """Integral of values (G,) that vanish at the ends of an even grid y (G,), as in eq. 2.16."""
    return float(values.sum() * (y[1] - y[0]))


def log_evidence(problem: Problem) -> float:
    """Logarithm of the evidence, the denominator of eq. 2.16."""
    joint = problem.log_prior + problem.log_likelihood
    top = joint.max()
    return float(top + np.log(integral(problem.y, np.exp(joint - top))))


def log_posterior(problem: Problem) -> np.ndarray:
    """Logarithm (G,) of the posterior density, eq. 2.16."""
    logs: np.ndarray = problem.log_prior + problem.log_likelihood - log_evidence(problem)
    return logs


def kl(y: np.ndarray, log_q: np.ndarray, log_p: np.ndarray) -> float:
    """KL(q || p) of two log densities (G,) on the grid y (G,), eq. 2.17."""
    return integral(y, np.exp(log_q) * (log_q - log_p))


def elbo(problem: Problem, log_q: np.ndarray) -> float:
    """Evidence lower bound of a log density (G,), eq. 2.19."""
    fit = integral(problem.y, np.exp(log_q) * problem.log_likelihood)
    return fit - kl(problem.y, log_q, problem.log_prior)


def best_gaussian(
    problem: Problem, means: Sequence[float], deviations: Sequence[float]
) -> tuple[float, float, float]:
    """ELBO, mean and deviation of the Gaussian with the largest ELBO on a grid, eq. 2.20."""
    return max(
        (elbo(problem, normal_log_density(problem.y, mean, deviation)), mean, deviation)
        for mean in means
        for deviation in deviations
    )


def elbo_picture(problem: Problem, mean: float, deviation: float) -> str:
    """A Gaussian beside the posterior, and log evidence = ELBO + KL as a bar, as HTML."""
    log_q = normal_log_density(problem.y, mean, deviation)
    bound, total = elbo(problem, log_q), log_evidence(problem)
    gap = kl(problem.y, log_q, log_posterior(problem))
    with look():
        figure = BookFigure(figsize=(6.0, 3.1))
        left, right = figure.subplots(1, 2)
        _draw_densities(left, problem, log_q)
        _draw_bound(right, problem, mean, deviation)
        sum_ = f"ELBO {bound:.2f} + KL {gap:.2f} = {total:.2f}"
        right.set_title(sum_.replace("-", "−"), fontsize=9)
    return picture_html(
        figure,
        f"Gaussian q with mean {mean:g} and deviation {deviation:g} beside a posterior with two "
        f"peaks: ELBO {bound:.2f}, KL {gap:.2f}, their sum {bound + gap:.2f}.",
    )


def _draw_densities(ax: Axes, problem: Problem, log_q: np.ndarray) -> None:
    posterior = np.exp(log_posterior(problem))
    ax.fill_between(problem.y, posterior, color=GREY, alpha=0.35, lw=0, label="posterior")
    ax.plot(problem.y, np.exp(problem.log_prior), ":", color=GREY, lw=1.4, label="prior")
    ax.plot(problem.y, np.exp(log_q), color=BLUE, label=r"$q_\xi$")
    ax.set(xlabel="$y$", ylabel="density", xlim=(-3.2, 3.2), ylim=(0, 1.5))
    ax.legend(loc="upper left", ncols=3, fontsize=8, handlelength=1.3, columnspacing=1)


def _draw_bound(ax: Axes, problem: Problem, mean: float, deviation: float) -> None:
    """The ELBO along the mean; at this mean a bar from 0 to log evidence and on to the ELBO."""
    y = problem.y
    along = [elbo(problem, normal_log_density(y, m, deviation)) for m in MEANS]
    here, total = elbo(problem, normal_log_density(y, mean, deviation)), log_evidence(problem)
    ax.plot(MEANS, along, color=BLUE, label="ELBO", zorder=3)
    ax.axhline(total, color=OPTIMUM, ls="--", lw=1.1, label=r"$\log P(X)$", zorder=3)
    ax.bar(mean, total, 0.24, color="#c9c9c9")
    ax.bar(mean, here - total, 0.24, bottom=total, color=ORANGE, label="KL")
    ax.plot(mean, here, "o", color=BLUE, ms=6, zorder=4, clip_on=True)
    ax.set(xlabel=r"mean of $q_\xi$", ylabel="nats", xlim=(-2.5, 2.5), ylim=(DEEPEST, 0))
    legend = ax.legend(loc="lower center", ncols=3, fontsize=8, handlelength=1.3, columnspacing=1)
    legend.set(frame_on=True, zorder=5)  # over the curve where that is steep
    legend.get_frame().set(edgecolor="none", alpha=0.9)
