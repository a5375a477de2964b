"""The mellowmax between the mean and the maximum, and how it shares out its gradient."""

from __future__ import annotations

import math

import torch
from matplotlib.axes import Axes
from torch import Tensor

from vtlib.mellow import mellowmax
from vtlib.plots import BookFigure, image_html, look, small_png

KAPPAS = (0.1, 1.0, 5.0, 10.0, 20.0, 50.0, 100.0, 1000.0)
Q_VALUES = (0.80, 0.50, 0.74, 0.20)  # of four actions in one state
ACCENT, REFERENCE = "#D55E00", "#1a1a1a"


def gradient_shares(values: Tensor, kappa: float) -> Tensor:
    """Derivatives (..., A) of the mellowmax (eq. 5.3) by each of values (..., A); they sum to 1."""
    shares: Tensor = torch.func.grad(lambda x: mellowmax(x, kappa).sum())(values)
    return shares


def shortfall(actions: int, kappa: float) -> float:
    """The most by which the mellowmax (eq. 5.3) of that many values lies below their maximum."""
    return math.log(actions) / kappa


def mellow_picture(kappa: float) -> str:
    """One kappa as an HTML picture: the mellowmax (eq. 5.3) of two values, and of four actions."""
    values = torch.tensor(Q_VALUES, dtype=torch.float64)
    value, shares = float(mellowmax(values, kappa)), gradient_shares(values, kappa)
    with look():
        figure = BookFigure(figsize=(6.5, 3.2))
        left, right = figure.subplots(1, 2)
        _draw_hinge(left, kappa)
        right.bar(range(len(values)), values.numpy(), color="#c9d6e3", width=0.7)
        for at, share in enumerate(shares.tolist()):
            right.text(at, 0.04, f"{share:.0%}", ha="center", fontsize=10)
        right.axhline(values.max(), color=REFERENCE, ls="--", lw=1.1)
        right.axhline(values.mean(), color=REFERENCE, ls=":", lw=1.1)
        right.axhline(value, color=ACCENT)
        right.set(xlabel="action, its share of the gradient", ylabel="Q-value", ylim=(0, 0.95))
        right.set_xticks(range(len(values)))
        right.set_title(f"mm = {value:.3f}")
        right.grid(False)
    largest = ", ".join(f"{share:.0%}" for share in shares.tolist())
    alt = (
        f"kappa = {kappa:g}: the mellowmax of {', '.join(f'{q:g}' for q in Q_VALUES)} is "
        f"{value:.3f}, between mean {values.mean():.2f} and maximum {values.max():.2f}; "
        f"shares of the gradient {largest}."
    )
    return image_html(small_png(figure), alt)


def _draw_hinge(ax: Axes, kappa: float) -> None:
    x = torch.linspace(-1, 1, 201, dtype=torch.float64)
    pairs = torch.stack([x, torch.zeros_like(x)], -1)
    ax.plot(x, pairs.amax(-1), "--", color=REFERENCE, lw=1.1, label="maximum")
    ax.plot(x, pairs.mean(-1), ":", color=REFERENCE, lw=1.1, label="mean")
    ax.plot(x, mellowmax(pairs, kappa), color=ACCENT, label="mellowmax")
    ax.set(xlabel="x", ylabel="of the values x and 0", ylim=(-0.6, 1.05))
    ax.set_title(f"κ = {kappa:g}")
    ax.legend(loc="upper left")
