"""Evidence, ELBO and Kullback-Leibler divergence of a posterior on a fine grid (section 2.2)."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np
from matplotlib.figure import Figure

from vtlib.illustrations.picture import BLACK, BLUE, GREY, ORANGE, picture

Y = np.linspace(-7, 7, 2801)


def gaussian(mean: float | np.ndarray, deviation: float) -> np.ndarray:
    """Log probabilities (..., G) of the grid Y under Gaussians, with means () or (..., 1)."""
    logs = -0.5 * ((Y - mean) / deviation) ** 2
    return np.asarray(logs - np.logaddexp.reduce(logs, -1, keepdims=True))


def log_evidence(log_prior: np.ndarray, log_likelihood: np.ndarray) -> float:
    """Logarithm of the evidence, the denominator of eq. 2.16, of prior and likelihood (G,)."""
    return float(np.logaddexp.reduce(log_prior + log_likelihood))


def log_posterior(log_prior: np.ndarray, log_likelihood: np.ndarray) -> np.ndarray:
    """Log probabilities (G,) of the posterior, eq. 2.16, from prior and likelihood (G,)."""
    return np.asarray(log_prior + log_likelihood - log_evidence(log_prior, log_likelihood))


def kl(log_q: np.ndarray, log_p: np.ndarray) -> np.ndarray:
    """KL(q || p) (...) of log probabilities (..., G), eq. 2.17."""
    return np.asarray((np.exp(log_q) * (log_q - log_p)).sum(-1))


def elbo(log_prior: np.ndarray, log_likelihood: np.ndarray, log_q: np.ndarray) -> np.ndarray:
    """Evidence lower bound (...) of log probabilities (..., G), eq. 2.19."""
    return np.asarray((np.exp(log_q) * log_likelihood).sum(-1) - kl(log_q, log_prior))


def best_gaussian(
    log_prior: np.ndarray, log_likelihood: np.ndarray, *grid: Iterable[float]
) -> tuple[float, ...]:
    """ELBO, mean and deviation of the Gaussian with the largest ELBO on a grid, eq. 2.20."""
    pairs = itertools.product(*grid)
    return max((float(elbo(log_prior, log_likelihood, gaussian(*pair))), *pair) for pair in pairs)


@picture(6.0, 3.1)
def elbo_picture(
    figure: Figure, log_prior: np.ndarray, log_likelihood: np.ndarray, mean: float, deviation: float
) -> str:
    """A Gaussian beside the posterior, and log evidence = ELBO + KL as a bar."""
    log_q, means = gaussian(mean, deviation), np.linspace(-2.4, 2.4, 121)
    posterior = log_posterior(log_prior, log_likelihood)
    total, gap = log_evidence(log_prior, log_likelihood), kl(log_q, posterior)
    bound = elbo(log_prior, log_likelihood, log_q)
    along = elbo(log_prior, log_likelihood, gaussian(means[:, None], deviation))
    left, right = figure.subplots(1, 2)
    step = Y[1] - Y[0]
    left.fill_between(Y, np.exp(posterior) / step, color=GREY, alpha=0.35, lw=0, label="posterior")
    left.plot(Y, np.exp(log_prior) / step, ":", color=GREY, label="prior")
    left.plot(Y, np.exp(log_q) / step, color=BLUE, label=r"$q_\xi$")
    left.set(xlabel="$y$", ylabel="density", xlim=(-3.2, 3.2), ylim=(0, 1.5))
    left.legend(loc="upper left", ncols=3)
    right.plot(means, along, color=BLUE, label="ELBO", zorder=3)
    right.axhline(total, color=BLACK, ls="--", label=r"$\log P(X)$", zorder=3)
    right.bar(mean, total, 0.24, color="#c9c9c9")
    right.bar(mean, bound - total, 0.24, bottom=total, color=ORANGE, label="KL")
    right.plot(mean, bound, "o", color=BLUE, ms=6, zorder=4)
    right.set(xlabel=r"mean of $q_\xi$", ylabel="nats", xlim=(-2.5, 2.5), ylim=(-14, 0))
    added = f"ELBO {bound:.2f} + KL {gap:.2f} = {total:.2f}"
    right.set_title(added.replace("-", "−"), fontsize=9)
    # The curve passes behind the legend where it is steep.
    right.legend(loc="lower center", ncols=3, frameon=True, edgecolor="none").set_zorder(5)
    return f"Gaussian q with mean {mean:g} and deviation {deviation:g}: {added}."
