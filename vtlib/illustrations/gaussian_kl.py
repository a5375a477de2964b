"""The KL of two Gaussians in the plane, part by part, and the pull of its gradient."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from matplotlib.axes import Axes
from torch import Tensor

from vtlib.gaussian import Gaussian, kl
from vtlib.plots import BookFigure, image_html, look, small_png

CORRELATIONS = (-0.8, -0.4, 0.0, 0.6, 0.9)
SHIFTS = (0.0, 1.0, 2.0)
PRIOR_CORRELATION = 0.6
POSTERIOR_SCALE = 0.7  # of its deviations: a posterior is narrower than its prior
Q_COLOUR, P_COLOUR = "#0072B2", "#6b6b6b"


class Parts(NamedTuple):
    """The three terms of eq. 5.7, each () and including its factor one half."""

    volume: Tensor
    spread: Tensor
    shift: Tensor


def planar(shift: float, correlation: float, scale: float) -> Gaussian:
    """A Gaussian (2,), (2, 2) with mean (shift, 0), both deviations scale, and that correlation."""
    below = math.sqrt(1 - correlation**2)
    L = scale * torch.tensor([(1.0, 0.0), (correlation, below)], dtype=torch.float64)
    return Gaussian(torch.tensor([shift, 0.0], dtype=torch.float64), L)


def kl_parts(q: Gaussian, p: Gaussian) -> Parts:
    """What volumes, spreads (Tr - d) and means add to KL(q || p) of (d,), (d, d), eq. 5.7."""
    moved = Gaussian(p.mu, q.L)
    volume = p.L.diagonal().log().sum() - q.L.diagonal().log().sum()
    spread = kl(moved, p) - volume
    return Parts(volume, spread, kl(q, p) - kl(moved, p))


def pull(q: Gaussian, p: Gaussian) -> Tensor:
    """Minus the gradient (d,) of the KL by the mean of q, eq. 5.8."""
    return -torch.cholesky_solve((q.mu - p.mu).unsqueeze(-1), p.L).squeeze(-1)


def ellipse(one: Gaussian, radius: float, points: int = 121) -> Tensor:
    """Points (points, 2) at Mahalanobis distance radius from the mean (2,)."""
    angle = torch.linspace(0, 2 * torch.pi, points, dtype=one.L.dtype)
    return one.mu + radius * torch.stack([angle.cos(), angle.sin()], -1) @ one.L.T


def kl_picture(correlation: float, shift: float) -> str:
    """One posterior as an HTML picture: its ellipses over the prior's, and the parts of eq. 5.7."""
    q, p = planar(shift, correlation, POSTERIOR_SCALE), planar(0.0, PRIOR_CORRELATION, 1.0)
    parts, forward, backward = kl_parts(q, p), float(kl(q, p)), float(kl(p, q))
    with look():
        figure = BookFigure(figsize=(6.5, 3.4))
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.05))
        _draw_ellipses(left, p, P_COLOUR, "prior p")
        _draw_ellipses(left, q, Q_COLOUR, "posterior q")
        if shift:
            arrow = 0.4 * pull(q, p)
            style = {"arrowstyle": "-|>", "color": "black", "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
            left.annotate("", (q.mu + arrow).tolist(), q.mu.tolist(), arrowprops=style)
        left.set(xlim=(-2.9, 3.6), ylim=(-2.5, 2.9), aspect="equal", xlabel="weight 1")
        left.set_ylabel("weight 2")
        left.legend(loc="upper left", ncols=2, handlelength=1.2, columnspacing=1.0)
        names, values = ["volume", "spread", "shift", "KL(q‖p)"], [*map(float, parts), forward]
        colours = ["#9cc3dd"] * 3 + [Q_COLOUR]
        right.barh(names, values, color=colours, height=0.65)
        for at, value in enumerate(values):
            right.text(max(value, 0) + 0.1, at, f"{value:.2f}".replace("-", "−"), va="center")
        right.set(xlim=(-1.0, 5.2), xlabel="nats", title=f"KL(p‖q) = {backward:.2f}")
        right.invert_yaxis()
        right.grid(False, axis="y")
    alt = (
        f"correlation = {correlation:g}, shift = {shift:g}: volume {parts.volume:.2f}, spread "
        f"{parts.spread:.2f} and shift {parts.shift:.2f} add up to KL(q||p) = {forward:.2f}; "
        f"KL(p||q) = {backward:.2f}."
    )
    return image_html(small_png(figure), alt)


def _draw_ellipses(ax: Axes, one: Gaussian, colour: str, label: str) -> None:
    ax.fill(*ellipse(one, 1).T, color=colour, alpha=0.25, lw=0)
    ax.plot(*ellipse(one, 1).T, color=colour, lw=1.4, label=label)
    ax.plot(*ellipse(one, 2).T, color=colour, lw=1.0, ls="--")
