"""Catoni's bound and the Gibbs posterior of a classifier with one threshold (section 2.3)."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from vtlib.illustrations.elbo import kl, log_posterior
from vtlib.illustrations.picture import BLUE, GREEN, GREY, ORANGE, picture

H = np.linspace(0, 1, 401)  # hypothesis h calls x in [0, 1] positive where x >= h
LOG_PRIOR = -0.5 * ((H - 0.35) / 0.15) ** 2
LOG_PRIOR -= np.logaddexp.reduce(LOG_PRIOR)
TARGET, FLIP = 0.6, 0.1  # labels follow this threshold, and are flipped with this probability
DELTA = 0.05  # of Theorem 2.4
SIZES = (5, 7, 10, 14, 20, 28, 40, 57, 80, 113, 160, 226, 320, 453, 640, 1280, 2560)


def draw_losses(count: int, rng: np.random.Generator) -> np.ndarray:
    """Zero-one losses (count, M) of the hypotheses H on independent samples, as in eq. 2.21."""
    x = rng.random(count)
    y = (x >= TARGET) ^ (rng.random(count) < FLIP)
    return np.asarray((x[:, None] >= H) != y[:, None]).astype(np.float64)


def true_risk() -> np.ndarray:
    """Generalisation error (M,) of the hypotheses H, eq. 2.22 in closed form."""
    return np.asarray(FLIP + (1 - 2 * FLIP) * np.abs(H - TARGET))


def gibbs_posterior(risk: np.ndarray, weight: float) -> np.ndarray:
    """Log probabilities (M,) of eq. 2.23, from the risk (M,), with Lambda = weight."""
    return log_posterior(LOG_PRIOR, -weight * risk)


def catoni_bound(risk: float, divergence: float, count: int, beta: float, delta: float) -> float:
    """Right-hand side of Theorem 2.4 for a posterior's empirical risk and its KL to the prior."""
    exponent = beta * risk + (divergence - np.log(delta)) / count
    return float(np.expm1(-exponent) / np.expm1(-beta))


def risks(losses: np.ndarray, lambda_: float) -> tuple[float, float, float]:
    """Empirical and true risk of the Gibbs posterior of losses (N, M), and Theorem 2.4's bound."""
    log_q = gibbs_posterior(losses.mean(0), len(losses) / lambda_)
    empirical, true = (float(np.exp(log_q) @ risk) for risk in (losses.mean(0), true_risk()))
    divergence = float(kl(log_q, LOG_PRIOR))
    return empirical, true, catoni_bound(empirical, divergence, len(losses), 1 / lambda_, DELTA)


@picture(6.0, 3.5)
def gibbs_picture(figure: Figure, losses: np.ndarray, count: int, lambda_: float) -> str:
    """The Gibbs posterior of the first count of losses (N, M), and risks and bound along N."""
    risk = losses[:count].mean(0)
    q = np.exp(gibbs_posterior(risk, count / lambda_))
    above, right, below = figure.subplot_mosaic([["above", "right"], ["below", "right"]]).values()
    above.plot(H, risk, color=ORANGE, label="empirical risk")
    above.plot(H, true_risk(), color=GREEN, ls="--", label="true risk")
    above.set(xlim=(0, 1), ylim=(0, 0.85), ylabel="risk")
    above.tick_params(labelbottom=False)
    # On a logarithmic axis, where eq. 2.23 is a sum, only the floor can be drawn of a zero.
    density = len(H) * q + 1e-9
    below.plot(H, len(H) * np.exp(LOG_PRIOR), ":", color=GREY, label="prior")
    below.fill_between(H, 1e-9, density, color=BLUE, alpha=0.25, lw=0)
    below.plot(H, density, color=BLUE, label="Gibbs posterior")
    below.set(xlim=(0, 1), yscale="log", ylim=(1e-3, 900))
    below.set(xlabel="threshold $h$", ylabel="density")
    empirical, true, bound = np.array([risks(losses[:n], lambda_) for n in SIZES]).T
    right.plot(SIZES, bound, color=BLUE, label="Catoni's bound")
    right.plot(SIZES, true, color=GREEN, ls="--", label="true risk")
    right.plot(SIZES, empirical, color=ORANGE, label="empirical risk")
    right.axvline(count, ymax=0.75, color=GREY, lw=1, ls=":")
    here = risks(losses[:count], lambda_)
    # A bound above 1 says nothing, and its dot would lie far above the axes.
    for y in filter(lambda y: y <= 1, here):
        right.plot(count, y, "k.", ms=7, clip_on=False)
    right.set(xscale="log", xlim=(SIZES[0], SIZES[-1]), ylim=(0, 1))
    right.set(xlabel="samples $N$", ylabel=r"mean under $q^*$")
    above.legend(loc="upper right")
    below.legend(loc="upper left")
    right.legend(loc="upper right")
    return (
        f"Gibbs posterior with N = {count} and lambda = {lambda_:g}: mean threshold {q @ H:.2f}; "
        f"empirical risk {here[0]:.2f}, true risk {here[1]:.2f}, bound {here[2]:.2f}."
    )
