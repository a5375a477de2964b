"""Coverage: how often the truth lies inside the posterior's central intervals."""

import torch
from torch import Tensor

from vtlib.qfunctions import QFunction

LEVELS = (0.5, 0.9, 0.95)


def posterior_samples(mu: Tensor, scale_tril: Tensor, noise: Tensor) -> Tensor:
    """Weights (R, C K, d) of mixtures with means mu (R, C, d) and factors scale_tril (R, C, d, d).

    noise: standard normal (R, C, K, d), K draws for each component.
    """
    return (mu.unsqueeze(2) + noise @ scale_tril.mT).flatten(1, 2)


def values_at(q: QFunction, weights: Tensor, obs: Tensor, action: Tensor) -> Tensor:
    """Values (R, K, B) of weights (R, K, d) at states (R, B, obs_dim) and actions (R, B)."""
    values = q.q(weights, q.prepare(obs))
    index = action[:, None, None].expand(-1, values.shape[1], 1, -1)
    return values.gather(2, index).squeeze(2)


def inside(values: Tensor, truth: Tensor) -> Tensor:
    """Share (..., R, levels) of true values (..., R, B) in the central intervals of (R, K, B).

    The shares of a calibrated posterior are the ``LEVELS``.
    """
    shares = []
    for level in LEVELS:
        ends = torch.tensor([(1 - level) / 2, (1 + level) / 2])
        low, high = values.quantile(ends, dim=1)
        shares.append(((truth >= low) & (truth <= high)).float().mean(-1))
    return torch.stack(shares, -1)
