"""Two priors made of the same sources: one Gaussian, and one kernel on each source."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from vtlib.gaussian import Gaussian, covariance_factor, sources_mean_and_spread
from vtlib.illustrations.gaussian_kl import ellipse
from vtlib.illustrations.mixture_kl import kernels, log_density
from vtlib.mixture import squared_distances
from vtlib.plots import BookFigure, image_html, look, small_png
from vtlib.transfer import PRIOR_JITTER

THESIS_WIDTH = 1e-5**0.5  # sigma_p
WIDTHS = (THESIS_WIDTH, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5)
PIXELS = 180
GVT, KERNELS = "#0072B2", "#D55E00"


def principal_directions(weights: Tensor) -> Tensor:
    """The two orthonormal directions (d, 2) in which weights (S, d) differ most."""
    right: Tensor = torch.linalg.svd(weights - weights.mean(0), full_matrices=False).Vh
    return right[:2].T


def explained(weights: Tensor, directions: Tensor) -> float:
    """Share of the variance of weights (S, d) that lies in orthonormal directions (d, 2)."""
    centred = weights - weights.mean(0)
    return float((centred @ directions).square().sum() / centred.square().sum())


def fitted(weights: Tensor) -> Gaussian:
    """The Gaussian (d,), (d, d) of eqs. 5.5 and 5.6 with GVT's jitter, from weights (S, d).

    Of projections on orthonormal directions it is the marginal of the Gaussian in all of them.
    """
    mu, spread = sources_mean_and_spread(weights)
    return Gaussian(mu, covariance_factor(spread, PRIOR_JITTER))


def mass(points: Tensor, width: float, x: Tensor, y: Tensor) -> Tensor:
    """Mass (ny - 1, nx - 1) of the prior of section 5.2.2 in each cell between edges x and y.

    points: (S, 2) sources; exact, however narrow the kernels are.
    """
    across, up = (
        torch.special.ndtr((edges - points[:, axis, None]) / width).diff(dim=1)
        for axis, edges in enumerate((x, y))
    )
    share: Tensor = up.T @ across / len(points)
    return share


def held_out(points: Tensor, width: float | None) -> float:
    """Mean log density of each source (S, d) under the prior made of the others, section 5.2.

    width is sigma_p of the kernels, or None for the single Gaussian.
    """
    logs = []
    for left_out in range(len(points)):
        rest = torch.cat([points[:left_out], points[left_out + 1 :]])
        if width is None:
            one = fitted(rest)
            prior = Gaussian(one.mu.unsqueeze(0), one.L.unsqueeze(0))
        else:
            prior = kernels(rest, width**2)
        logs.append(float(log_density(points[left_out, None], prior)))
    return float(np.mean(logs))


def nearest(weights: Tensor) -> Tensor:
    """Distance (S,) of each of weights (S, d) from the nearest other."""
    apart = squared_distances(weights, weights).fill_diagonal_(torch.inf)
    return apart.amin(-1).sqrt()


def prior_picture(weights: Tensor, width: float) -> str:
    """One kernel width as an HTML picture: mass of the kernels (section 5.2.2), ellipses of GVT."""
    directions = principal_directions(weights)
    points = (weights - weights.mean(0)) @ directions
    gaussian = fitted(points)
    low, high = points.amin(0) - 0.7, points.amax(0) + 0.7
    x, y = (torch.linspace(low[k], high[k], PIXELS + 1).double() for k in range(2))
    share = mass(points, width, x, y)
    scores = held_out(points, width), held_out(points, None)
    with look():
        figure = BookFigure(figsize=(6.5, 4.2))
        ax = figure.subplots()
        (left, right), (bottom, top) = ((float(low[k]), float(high[k])) for k in range(2))
        # few levels and square pixels: smooth shades would make the picture ten times heavier
        levels = (12 * (share / share.amax()).sqrt()).round().numpy()
        ax.imshow(
            levels,
            extent=(left, right, bottom, top),
            cmap="Oranges",
            vmax=15,
            origin="lower",
            aspect="auto",
            interpolation="nearest",
        )
        for radius, style in ((1, "-"), (2, "--")):
            label = f"GVT: {radius} deviation{'s' * (radius > 1)}"
            ax.plot(*ellipse(gaussian, radius).T, color=GVT, ls=style, lw=1.4, label=label)
        ax.plot(*points.T, ".", color="black", ms=4, label="sources")
        ax.set(xlabel="first principal direction of the weights", ylabel="second")
        ax.set(xlim=(left, right), ylim=(bottom, top), title=f"σₚ = {width:.2g}")
        ax.legend(loc="lower left", ncols=3, frameon=True)
        ax.grid(False)
    alt = (
        f"kernels of width {width:.2g} on {len(weights)} sources, over the ellipses of one "
        f"Gaussian; mean held-out log density {scores[0]:.2f} against {scores[1]:.2f}."
    )
    return image_html(small_png(figure), alt)
