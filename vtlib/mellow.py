"""The mellow Bellman operator: mellowmax, the TD error, and the psi-mixed gradient."""

from __future__ import annotations

import torch
from torch import Tensor

from vtlib.checks import check_between, check_positive
from vtlib.exponential import exp_of_differences


def mellowmax(values: Tensor, kappa: float, dim: int = -1) -> Tensor:
    """Softened maximum of eq. 5.3: log of the mean of exp(kappa * values), over kappa, along dim.

    Lies between the mean (kappa -> 0) and the maximum (kappa -> infinity), and is a
    non-expansion. Source: Asadi and Littman (2017). Raises ValueError unless kappa is finite and
    positive.
    """
    check_positive("kappa", kappa)
    top = values.amax(dim, keepdim=True)
    # the mean (not logsumexp minus a log) makes the mellowmax of equal values exact
    soft = exp_of_differences(kappa * (values - top)).mean(dim, keepdim=True).log_().div_(kappa)
    return (top + soft).squeeze(dim)


def td_error(
    q: Tensor,
    q_next: Tensor,
    action: Tensor,
    reward: Tensor,
    terminal: Tensor,
    gamma: float = 0.99,
    kappa: float = 100.0,
) -> Tensor:
    """TD errors r + gamma mm_a' Q(s', a') - Q(s, a) (eq. 2.15 with the mellowmax of eq. 5.3).

    q, q_next: (..., A, B), actions before transitions; action int64, reward, terminal bool:
    broadcastable to (..., B). A terminal next state has value zero. Returns (..., B).
    """
    chosen = q.gather(-2, _row(action, q)).squeeze(-2)
    return reward + gamma * mellowmax(q_next, kappa, -2) * ~terminal - chosen


def td_cotangent(
    q: Tensor,
    q_next: Tensor,
    action: Tensor,
    reward: Tensor,
    terminal: Tensor,
    psi: float,
    gamma: float = 0.99,
    kappa: float = 100.0,
) -> tuple[Tensor, Tensor]:
    """Derivatives of the mean squared TD error with respect to Q(s, .) and Q(s', .), eq. 5.4.

    Shapes as in ``td_error``; the derivative through the next state is weighted by psi: 1 gives
    the full gradient, 0 the semi-gradient. Returns two tensors shaped like q and q_next; pulled
    back through Q they give the gradient with respect to the weights. Terminal next states drop
    out of both the target and the psi part.
    """
    batch = q.shape[-1]
    alive = gamma * ~terminal
    top = q_next.amax(-2, keepdim=True)
    weights = exp_of_differences(kappa * (q_next - top))
    mean = weights.mean(-2, keepdim=True)
    value = top.add(mean.log(), alpha=1 / kappa).squeeze(-2)
    index = _row(action, q)
    scaled_error = (reward + alive * value - q.gather(-2, index).squeeze(-2)).mul_(2 / batch)
    at_state = torch.zeros_like(q).scatter_(-2, index, -scaled_error.unsqueeze(-2))
    flow = (scaled_error * alive).unsqueeze(-2).div_(mean).mul_(psi / q.shape[-2])
    return at_state, weights.mul_(flow)


def _row(action: Tensor, q: Tensor) -> Tensor:
    """Actions (..., B) as an index (..., 1, B) into the action axis of q."""
    return action.unsqueeze(-2).expand(*q.shape[:-2], 1, q.shape[-1])


def check_psi(psi: float) -> None:
    """Raise ValueError unless psi lies in [0, 1]."""
    check_between("psi", psi, 0, 1)
