"""The KL of two Gaussians in the plane, part by part, and the pull of its gradient."""

from __future__ import annotations

import torch
from torch import Tensor

from vtlib.priors import Gaussian, kl


def planar(shift: float, correlation: float, scale: float) -> Gaussian:
    """A Gaussian (2,), (2, 2) with mean (shift, 0), both deviations scale, and that correlation."""
    below = (1 - correlation**2) ** 0.5
    factor = scale * torch.tensor([(1.0, 0.0), (correlation, below)], dtype=torch.float64)
    return Gaussian(torch.tensor([shift, 0.0], dtype=torch.float64), factor)


def kl_parts(q: Gaussian, p: Gaussian) -> tuple[Tensor, Tensor, Tensor]:
    """What volumes, spreads (Tr - d) and means add to KL(q || p) of (d,), (d, d), eq. 5.7."""
    unmoved = kl(Gaussian(p.mu, q.scale_tril), p)
    volume = p.scale_tril.diagonal().log().sum() - q.scale_tril.diagonal().log().sum()
    return volume, unmoved - volume, kl(q, p) - unmoved


def pull(q: Gaussian, p: Gaussian) -> Tensor:
    """Minus the gradient (d,) of KL(q || p) of (d,), (d, d) by the mean of q, eq. 5.8."""
    gradient: Tensor = torch.func.grad(lambda mu: kl(Gaussian(mu, q.scale_tril), p))(q.mu)
    return -gradient


def ellipse(one: Gaussian, radius: float) -> Tensor:
    """Points (121, 2) at Mahalanobis distance radius from the mean (2,)."""
    angle = torch.linspace(0, 2 * torch.pi, 121, dtype=one.mu.dtype)
    return one.mu + radius * torch.stack([angle.cos(), angle.sin()], -1) @ one.scale_tril.T
