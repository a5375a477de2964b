"""Exact posteriors over value functions that close in on a task as transitions arrive.

A walker crosses a corridor of length 10 at speed 1; in a stretch of mud it is four times slower. It
is paid at the far end, and tasks differ in where the mud lies. There is one action, so that the
mellowmax is the value itself, each TD error is linear in the weights, and the optimal Gibbs
posterior of eq. 5.1 has a closed form under a Gaussian prior and under a mixture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from matplotlib.axes import Axes
from torch import Tensor

from vtlib.gaussian import Gaussian, covariance_factor, sources_mean_and_spread
from vtlib.illustrations.mixture_kl import kernels
from vtlib.plots import BookFigure, image_html, look, small_png
from vtlib.transfer import PRIOR_JITTER

LENGTH, MUD, SLOW = 10.0, 2.0, 0.25  # the corridor, the stretch of mud, the speed in it
GAMMA = 0.9
BASES, VARIANCE = 21, 0.35**2
SOURCE_MUD = (1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5, 8.5)  # the middle of the mud in each source
TARGET_MUD = 5.2
LAMBDA, SIGMA_P = 1e-3, 0.03
COUNTS = (0, 2, 4, 6, 8, 10, 12, 16, 32, 64, 256)
GVT, MGVT, TRUTH = "#0072B2", "#D55E00", "#1a1a1a"


@dataclass(frozen=True)
class Posterior:
    """A mixture of Gaussians: log weights (J,), means (J, d) and their common covariance (d, d)."""

    log_weights: Tensor
    mu: Tensor
    covariance: Tensor


def remaining_time(s: Tensor, mud: float) -> Tensor:
    """Time (...) from positions s (...) to the end of the corridor."""
    muddy = (mud + MUD / 2 - s.clamp(min=mud - MUD / 2)).clamp(min=0)
    return LENGTH - s + muddy * (1 / SLOW - 1)


def next_position(s: Tensor, mud: float) -> Tensor:
    """Positions (...) one unit of time after s (...), the end of the corridor at most."""
    left = (remaining_time(s, mud) - 1).clamp(min=0)
    behind = LENGTH - left  # right where no mud is left
    entry, leave = mud - MUD / 2, mud + MUD / 2
    inside = leave - (left - (LENGTH - leave)) * SLOW
    before = entry - (left - (LENGTH - leave) - MUD / SLOW)
    return torch.where(behind >= leave, behind, torch.where(inside >= entry, inside, before))


def features(s: Tensor) -> Tensor:
    """Normalised radial bases (..., 21) at positions s (...)."""
    centers = torch.linspace(0, LENGTH, BASES, dtype=s.dtype)
    return torch.softmax(-0.5 * (s.unsqueeze(-1) - centers) ** 2 / VARIANCE, -1)


def value(s: Tensor, mud: float) -> Tensor:
    """True values (...) at s (...): gamma to the power of the time that remains."""
    return GAMMA ** remaining_time(s, mud)


def source_weights() -> Tensor:
    """Weights (8, 21) of the sources, fitted to their true values by ridge regression."""
    s = torch.linspace(0, LENGTH, 401, dtype=torch.float64)
    x = features(s)
    gram = x.T @ x + 1e-6 * torch.eye(BASES, dtype=torch.float64)
    values = torch.stack([value(s, mud) for mud in SOURCE_MUD], -1)
    weights: Tensor = torch.linalg.solve(gram, x.T @ values)
    return weights.T


def walk(count: int, rng: np.random.Generator) -> tuple[Tensor, Tensor, Tensor]:
    """Transitions through the target: positions (N,), rows x (N, d) and rewards r (N,).

    Their TD errors (eq. 2.15) are r - x w. Each episode begins somewhere in the first metre.
    """
    rows: list[Tensor] = []
    at: list[Tensor] = []
    s = torch.tensor(math.nan, dtype=torch.float64)
    while len(at) < count:
        if not s < LENGTH:
            s = torch.tensor(rng.uniform(0, 1), dtype=torch.float64)
        at.append(s)
        s = next_position(s, TARGET_MUD)
        rows.append(features(at[-1]) - GAMMA * features(s) * (s < LENGTH))
    positions = torch.tensor(at, dtype=torch.float64)
    last = remaining_time(positions, TARGET_MUD) <= 1
    rewards = value(positions, TARGET_MUD) * last
    return positions, torch.stack(rows) if rows else torch.zeros(0, BASES).double(), rewards


def gibbs(prior: Gaussian, x: Tensor, r: Tensor, lambda_: float) -> Posterior:
    """The posterior of eq. 5.1 with Lambda = N / lambda, for N TD errors r - x w, (N,) and (N, d).

    prior: equally weighted components, means (J, d) and one factor (d, d). The TD errors act like
    Gaussian noise of variance lambda / 2.
    """
    pull = prior.L.T @ x.T  # (d, N)
    noise = lambda_ / 2 * torch.eye(len(r), dtype=x.dtype)
    gain = torch.linalg.solve(noise + pull.T @ pull, pull.T @ prior.L.T)  # (N, d)
    surprise = r - prior.mu @ x.T  # (J, N)
    evidence = torch.linalg.solve(noise + pull.T @ pull, surprise.T).T
    covariance = prior.L @ prior.L.T - (prior.L @ pull) @ gain
    log_weights = torch.log_softmax(-0.5 * (surprise * evidence).sum(-1), 0)
    return Posterior(log_weights, prior.mu + surprise @ gain, covariance)


def priors(sources: Tensor) -> dict[str, Gaussian]:
    """The priors of GVT (eqs. 5.5, 5.6) and MGVT of sources (J, d), with one factor (d, d) each."""
    mu, spread = sources_mean_and_spread(sources)
    one = Gaussian(mu.unsqueeze(0), covariance_factor(spread, PRIOR_JITTER))
    return {"GVT": one, "MGVT": Gaussian(sources, kernels(sources, SIGMA_P**2).L[0])}


def mean_error(posterior: Posterior) -> float:
    """Largest distance of the posterior's mean value from the target's true value."""
    s = torch.linspace(0, LENGTH, 401, dtype=torch.float64)
    mean = posterior.log_weights.exp() @ posterior.mu
    return float((features(s) @ mean - value(s, TARGET_MUD)).abs().max())


def collapse_picture(sources: Tensor, data: tuple[Tensor, Tensor, Tensor], count: int) -> str:
    """One number of transitions as an HTML picture: both posteriors of eq. 5.1 as values."""
    positions, x, r = (part[:count] for part in data)
    found = {name: gibbs(p, x, r, LAMBDA) for name, p in priors(sources).items()}
    with look():
        figure = BookFigure(figsize=(6.5, 3.6))
        axes = figure.subplots(1, 2, sharey=True)
        for ax, (name, posterior) in zip(axes, found.items(), strict=True):
            _draw(ax, posterior, GVT if name == "GVT" else MGVT)
            ax.plot(positions, torch.full_like(positions, 0.04), "|", color="black", ms=9)
            ax.set(xlabel="position", xlim=(0, LENGTH), ylim=(0, 1.05))
        top = float(found["MGVT"].log_weights.max().exp())
        axes[0].set(ylabel="value", title=f"one Gaussian, N = {count}")
        axes[1].set_title(f"one kernel per source: largest weight {top:.2f}")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
    errors = {name: mean_error(posterior) for name, posterior in found.items()}
    alt = (
        f"N = {count} transitions: the mean value errs by at most {errors['GVT']:.3f} with one "
        f"Gaussian and {errors['MGVT']:.3f} with kernels, whose largest weight is {top:.2f}."
    )
    return image_html(small_png(figure), alt)


def _draw(ax: Axes, posterior: Posterior, colour: str) -> None:
    s = torch.linspace(0, LENGTH, 201, dtype=torch.float64)
    x = features(s)
    deviation = ((x @ posterior.covariance) * x).sum(-1).clamp(min=0).sqrt()
    for log_weight, mu in zip(posterior.log_weights, posterior.mu, strict=True):
        weight, mean = float(log_weight.exp()), x @ mu
        low, high = mean - 2 * deviation, mean + 2 * deviation
        ax.fill_between(s, low, high, color=colour, alpha=0.25 * weight**0.5, lw=0)
        ax.plot(s, mean, color=colour, alpha=weight**0.5, lw=1.4)
    ax.plot(s, value(s, TARGET_MUD), "--", color=TRUTH, lw=1.3, label="true value")
    ax.plot([], [], color=colour, label="mean of a component, ±2 deviations")
    ax.plot([], [], "|", color="black", ms=9, label="visited")
