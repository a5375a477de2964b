"""Where stochastic gradient descent on the posterior's factor L stops being stable.

The gradient of the expected squared TD error by L is H L (``vtlib.stability``). Let eta be the
largest eigenvalue of H, u and p its left and right eigenvectors with u^T p = 1, and l = u^T L. From
n normal samples v (eq. 5.11) the gradient is estimated as H L V, V the mean of v v^T; the TD errors
at the mean, whose part has no L in it, are left out, as the divergence is. As row i of L ends at
column i, a step of size alpha takes l to

    l_j - alpha eta c_j (l V)_j,    c_j = sum of u_i p_i over i >= j.

For a fixed l, E (l V)_j^2 = ((n + 1) l_j^2 + |l|^2) / n. With 0 < c_j <= 1 the squares of l tend to
0 on average if alpha eta < 2 n / (d_eta + n + 1), d_eta = sum of c_j = sum of i u_i p_i: the mean
length of L's rows along the eigenvectors. For rows of one length, d_eta = d, they grow above that.
"""

import torch
from torch import Tensor

from vtlib.qfunctions import QFunction
from vtlib.replay import Transition
from vtlib.stability import gradients_of_errors

OFF = 1e-6  # relative; so far beside an eigenvalue its eigenvector is looked for


def largest_step(length: Tensor | float, samples: int) -> Tensor | float:
    """The bound on alpha eta, for rows of L of a mean length d_eta (R,) and n samples."""
    return 2 * samples / (length + samples + 1)


def steepest(
    q: QFunction, mu: Tensor, batch: Transition, psi: float, gamma: float, kappa: float
) -> tuple[Tensor, Tensor]:
    """Eigenvalue eta (R,) of H, and d_eta (R,), in float64.

    At weights mu (R, d), over a mini-batch (R, B). H is not symmetric unless psi is 1; of a complex
    pair the modulus and the real part are taken.
    """
    f, h = gradients_of_errors(q, mu, batch, psi, gamma, kappa)
    H = torch.bmm(h.mT, f).double() * (2 / batch.action.shape[1])
    values, vectors = torch.linalg.eig(H)
    top = values.abs().argmax(1)
    rows = torch.arange(len(mu))
    eta, p = values[rows, top], vectors[rows, :, top]
    beside = H.mT - (eta * (1 + OFF)).view(-1, 1, 1) * torch.eye(H.shape[-1])
    u = p
    for _ in range(2):
        u = torch.linalg.solve(beside, u)
        u = u / u.norm(dim=1, keepdim=True)
    share = u * p / (u * p).sum(1, keepdim=True)
    length = (share.real * torch.arange(1, H.shape[-1] + 1)).sum(1)
    return eta.abs(), length
