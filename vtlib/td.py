"""Temporal-difference errors under the mellow Bellman operator, and their psi-mixed gradients."""

import math

import torch
from torch import Tensor

from vtlib.qfunctions import QFunction
from vtlib.replay import Transition

LEAST_KAPPA = 1e-3  # float32 has four digits left of 1 - exp(-kappa)
CACHED = 1 << 20  # floats that the cache holds


def mellowmax(values: Tensor, kappa: float, dim: int = -1) -> Tensor:
    """Softened maximum of eq. 5.3: log of the mean of exp(kappa * values), over kappa, along dim.

    Lies between the mean (kappa -> 0) and the maximum (kappa -> infinity). Source: Asadi and
    Littman (2017).
    """
    top = values.amax(dim, keepdim=True)
    # the mean (not logsumexp minus a log) makes the mellowmax of equal values exact
    soft = exp_of_differences(kappa * (values - top)).mean(dim, keepdim=True).log_().div_(kappa)
    return (top + soft).squeeze(dim)


def td_error(
    q: Tensor,
    q_next: Tensor,
    action: Tensor,
    reward: Tensor,
    terminated: Tensor,
    gamma: float = 0.99,
    kappa: float = 100.0,
) -> Tensor:
    """TD errors r + gamma mm_a' Q(s', a') - Q(s, a) (eq. 2.15 with the mellowmax of eq. 5.3).

    q, q_next: (..., A, B), actions before transitions; action int64, reward, terminated bool:
    broadcastable to (..., B). A terminal next state has value zero. Returns (..., B).
    """
    value = q.gather(-2, _row(action, q)).squeeze(-2)
    return reward + gamma * mellowmax(q_next, kappa, -2) * ~terminated - value


def td_cotangent(
    q: Tensor,
    q_next: Tensor,
    action: Tensor,
    reward: Tensor,
    terminated: Tensor,
    psi: float,
    gamma: float = 0.99,
    kappa: float = 100.0,
) -> tuple[Tensor, Tensor]:
    """Derivatives of the mean squared TD error with respect to Q(s, .) and Q(s', .), eq. 5.4.

    Shapes as in ``td_error``; the derivative through the next state is weighted by psi: 1 gives
    the full gradient, 0 the semi-gradient. Returns two tensors shaped like q and q_next; pulled
    back through Q they give the gradient with respect to the weights.
    """
    batch = q.shape[-1]
    alive = gamma * ~terminated
    top = q_next.amax(-2, keepdim=True)
    weights = exp_of_differences(kappa * (q_next - top))
    mean = weights.mean(-2, keepdim=True)
    value = top.add(mean.log(), alpha=1 / kappa).squeeze(-2)
    index = _row(action, q)
    scaled_error = (reward + alive * value - q.gather(-2, index).squeeze(-2)).mul_(2 / batch)
    at_state = torch.zeros_like(q).scatter_(-2, index, -scaled_error.unsqueeze(-2))
    flow = (scaled_error * alive).unsqueeze(-2).div_(mean).mul_(psi / q.shape[-2])
    return at_state, weights.mul_(flow)


def td_gradients(
    q: QFunction, w: Tensor, batch: Transition, psi: float, gamma: float, kappa: float
) -> Tensor:
    """Gradients (R, K, d) of the mean squared TD error at weights w (R, K, d), eq. 5.4.

    batch: a minibatch (R, B) for each run, shared by its K weight vectors.
    """
    # few runs at a time: the values of hidden units for all of them would not fit into the cache
    rows = max(1, CACHED // (2 * batch.obs.shape[1] * q.width * w.shape[1]))
    parts = zip(*(x.split(rows) for x in (w, *batch)), strict=True)
    each = [_td_gradients(q, x, Transition(*rest), psi, gamma, kappa) for x, *rest in parts]
    return torch.cat(each)


def _td_gradients(
    q: QFunction, w: Tensor, batch: Transition, psi: float, gamma: float, kappa: float
) -> Tensor:
    size = batch.obs.shape[1]
    # states and next states pass through Q together
    values, pullback = q.vjp(w, q.prepare(torch.cat([batch.obs, batch.next_obs], 1)))
    cotangents = td_cotangent(
        values[..., :size],
        values[..., size:],
        batch.action.unsqueeze(1),
        batch.reward.unsqueeze(1),
        batch.terminated.unsqueeze(1),
        psi,
        gamma,
        kappa,
    )
    return pullback(torch.cat(cotangents, -1))


def exp_of_differences(x: Tensor) -> Tensor:
    """exp(x) of differences x <= 0 from the largest term of a sum; x is overwritten.

    Zero where the sum, which is at least one, would round it away: denormal numbers are slow.
    """
    rounding = torch.finfo(x.dtype).eps
    x = x.clamp_(min=math.log(rounding) - 1).exp_()
    # not in place: autograd still needs the exponentials
    return torch.nn.functional.threshold(x, rounding, 0.0)


def _row(action: Tensor, q: Tensor) -> Tensor:
    """Actions (..., B) as an index (..., 1, B) into the action axis of q."""
    return action.unsqueeze(-2).expand(*q.shape[:-2], 1, q.shape[-1])
