"""The bound on the KL of two mixtures against the KL itself, as one component moves."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from matplotlib.axes import Axes
from torch import Tensor

from vtlib.gaussian import Gaussian
from vtlib.mixture import kl_bound, pairwise_kl, responsibilities
from vtlib.plots import BookFigure, image_html, look, small_png

PLACES = tuple(round(-2.5 + 0.25 * k, 2) for k in range(21))  # of the moving component
SOURCES = (-1.5, 0.3, 1.2)
VARIANCE = 0.16  # of the prior's components
RESTING = 1.0  # mean of the other component
DEVIATIONS = (0.5, 0.3)  # of the two
SAMPLES = 4000  # for each component
Q_COLOUR, P_COLOUR = "#D55E00", "#6b6b6b"


@dataclass(frozen=True)
class Comparison:
    """What is known with the moving component at one place: tables are (C, S)."""

    place: float
    bound: float
    estimate: float  # of the KL by Monte Carlo
    error: float  # its standard error
    theta: np.ndarray
    phi: np.ndarray


def log_density(x: Tensor, components: Gaussian) -> Tensor:
    """Log density (n,) at x (n, d) of equal components (C, d), (C, d, d), section 5.2.2."""
    count, d = components.mu.shape
    apart = (x - components.mu.unsqueeze(1)).transpose(1, 2)
    whitened: Tensor = torch.linalg.solve_triangular(components.L, apart, upper=False)
    squares = whitened.square().sum(1)
    volumes = components.L.diagonal(dim1=-2, dim2=-1).log().sum(-1, keepdim=True)
    logs = -0.5 * squares - volumes - 0.5 * d * math.log(2 * math.pi)
    return logs.logsumexp(0) - math.log(count)


def monte_carlo_kl(
    q: Gaussian, p: Gaussian, samples: int, rng: np.random.Generator
) -> tuple[float, float]:
    """KL(q || p) of mixtures (C, d) and (S, d), eq. 2.17, by that many samples of each component.

    Returns the estimate and its standard error, which counts the components as strata.
    """
    count, d = q.mu.shape
    noise = torch.from_numpy(rng.standard_normal((count, samples, d)))
    x = (q.mu.unsqueeze(1) + noise @ q.L.transpose(1, 2)).flatten(0, 1)
    ratios = (log_density(x, q) - log_density(x, p)).view(count, samples)
    error = (ratios.var(1).sum() / samples).sqrt() / count
    return float(ratios.mean()), float(error)


def kernels(sources: Tensor, variance: float) -> Gaussian:
    """The prior of section 5.2.2 by its components: means sources (S, d), factors (S, d, d)."""
    count, d = sources.shape
    eye = torch.eye(d, dtype=sources.dtype) * variance**0.5
    return Gaussian(sources, eye.repeat(count, 1, 1))


def posterior(place: float) -> Gaussian:
    """Two components on a line, (2, 1) and (2, 1, 1), the first with its mean at that place."""
    mu = torch.tensor([[place], [RESTING]], dtype=torch.float64)
    return Gaussian(mu, torch.tensor(DEVIATIONS, dtype=torch.float64).view(2, 1, 1))


def compare(place: float, rng: np.random.Generator) -> Comparison:
    """The bound of eq. 5.13 with the tables of eqs. 5.14 and 5.15, and the KL by Monte Carlo."""
    q, sources = posterior(place), torch.tensor(SOURCES, dtype=torch.float64).unsqueeze(1)
    pairwise = pairwise_kl(q, sources, VARIANCE)
    log_theta, log_phi = responsibilities(pairwise)
    estimate, error = monte_carlo_kl(q, kernels(sources, VARIANCE), SAMPLES, rng)
    return Comparison(
        place,
        float(kl_bound(pairwise, log_theta, log_phi)),
        estimate,
        error,
        log_theta.exp().numpy(),
        log_phi.exp().numpy(),
    )


def bound_picture(all_places: list[Comparison], index: int) -> str:
    """One place as an HTML picture: densities, bound (eq. 5.13) and KL, and the two tables."""
    now = all_places[index]
    with look():
        figure = BookFigure(figsize=(6.5, 5.0))
        (densities, curves), (theta, phi) = figure.subplots(2, 2, height_ratios=(1.4, 1))
        _draw_densities(densities, now.place)
        _draw_curves(curves, all_places, now)
        _draw_table(theta, now.theta, "ϑ: rows sum to 1/2")
        _draw_table(phi, now.phi, "φ: columns sum to 1/3")
    alt = (
        f"first component at {now.place:g}: bound {now.bound:.2f}, KL {now.estimate:.2f} with "
        f"standard error {now.error:.2f}; its theta is {_row(now.theta[0])}, its phi "
        f"{_row(now.phi[0])}."
    )
    return image_html(small_png(figure), alt)


def _row(values: np.ndarray) -> str:
    return ", ".join(f"{value:.2f}" for value in values)


def _draw_densities(ax: Axes, place: float) -> None:
    x = torch.linspace(-4, 4, 401, dtype=torch.float64).unsqueeze(1)
    sources = torch.tensor(SOURCES, dtype=torch.float64).unsqueeze(1)
    p, q = (log_density(x, m).exp() for m in (kernels(sources, VARIANCE), posterior(place)))
    ax.fill_between(x[:, 0], p, color=P_COLOUR, alpha=0.3, lw=0, label="prior p")
    ax.plot(x[:, 0], q, color=Q_COLOUR, label="posterior q")
    for name, at in (("1", place), ("2", RESTING)):
        ax.text(at, -0.1, name, color=Q_COLOUR, ha="center", va="center", weight="bold")
    ax.set(xlim=(-4, 4), ylim=(-0.18, 1.15), xlabel="weight", ylabel="density")
    ax.legend(loc="upper left", handlelength=1.2)


def _draw_curves(ax: Axes, all_places: list[Comparison], now: Comparison) -> None:
    x = [one.place for one in all_places]
    ax.plot(x, [one.bound for one in all_places], color=Q_COLOUR, label="bound on the KL")
    means, bars = ([getattr(one, key) for one in all_places] for key in ("estimate", "error"))
    two = 2 * np.array(bars)
    ax.errorbar(x, means, two, fmt=".", color="#0072B2", ms=4, capsize=2, lw=1, label="KL, sampled")
    ax.plot(now.place, now.bound, "o", color=Q_COLOUR, ms=8)
    ax.plot(now.place, now.estimate, "o", color="#0072B2", ms=8, mfc="none")
    ax.set(ylim=(-0.1, 4), xlabel="place of component 1", ylabel="nats")
    ax.legend(loc="upper center")


def _draw_table(ax: Axes, table: np.ndarray, title: str) -> None:
    ax.imshow(table, cmap="Oranges", vmin=0, vmax=0.6, aspect="auto")
    for (i, j), value in np.ndenumerate(table):
        ax.text(j, i, f"{value:.2f}", ha="center", va="center")
    ax.set_xticks(range(table.shape[1]), [f"{w:g}" for w in SOURCES])
    ax.set_yticks(range(table.shape[0]), ["1", "2"])
    ax.set(xlabel="source at", ylabel="component", title=title)
    ax.grid(False)
