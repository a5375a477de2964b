"""The largest curvature of the squared TD error.

Near some weights the TD error is linear in them, and the gradient of its expected square by the
factor L of a posterior is H L with H = 2 E[h f^T]: f the gradient of a TD error by the weights, h
its psi-mixed gradient (eq. 5.4). The curvature is eta, the largest eigenvalue of H.
"""

import torch
from torch import Tensor

from vtlib.qfunctions import QFunction
from vtlib.replay import Transition


def curvature(
    q: QFunction, mu: Tensor, batch: Transition, psi: float, gamma: float, kappa: float
) -> Tensor:
    """The modulus (R,) of eta at weights mu (R, d), over a minibatch (R, B), in float64.

    At the cost of a matrix B x B: the eigenvalues of f h^T are those of H but for zeros. H is not
    symmetric unless psi is 1, and eta may be one of a complex pair. NaN where weights are.
    """
    f, h = gradients_of_errors(q, mu, batch, psi, gamma, kappa)
    K = torch.bmm(f, h.mT).double() * (2 / batch.action.shape[1])
    finite = K.isfinite().all(2).all(1)
    # some builds of LAPACK crash on numbers that are not finite
    eta = torch.linalg.eigvals(torch.where(finite.view(-1, 1, 1), K, 0.0)).abs().amax(1)
    return torch.where(finite, eta, torch.nan)


def gradients_of_errors(
    q: QFunction, mu: Tensor, batch: Transition, psi: float, gamma: float, kappa: float
) -> tuple[Tensor, Tensor]:
    """Gradients f and h (R, B, d) of each TD error, whole and psi-mixed."""
    runs, size = batch.action.shape
    pairs = torch.stack([batch.obs, batch.next_obs], 2).flatten(0, 1)
    weights = mu.unsqueeze(1).expand(-1, size, -1).reshape(runs * size, 1, -1)
    values, pullback = q.vjp(weights, q.prepare(pairs))
    now, after = torch.zeros_like(values), torch.zeros_like(values)
    now[..., 0].scatter_(2, batch.action.view(-1, 1, 1), 1.0)
    alive = gamma * ~batch.terminated
    after[..., 1] = torch.softmax(kappa * values[..., 1], 2) * alive.view(-1, 1, 1)
    at_state, at_next = (pullback(x).view(runs, size, -1) for x in (now, after))
    return at_next - at_state, psi * at_next - at_state
