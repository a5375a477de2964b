"""A Q-function's last layer, in whose weights it is linear, and the features that they multiply."""

import torch
from torch import Tensor

from vtlib.checks import check_kind
from vtlib.qfunctions import MLP, RBFLinear


class LastLayer:
    """The ``last`` weights (A, m) of each action, as places among all of a Q-function's.

    Those of a network end in the action's bias, whose feature is one. Raises ValueError for a
    Q-function of another kind.
    """

    def __init__(self, q: MLP | RBFLinear) -> None:
        check_kind("q", q, MLP | RBFLinear)
        self._hidden: MLP | None = None
        if isinstance(q, RBFLinear):
            self.last = torch.arange(q.d).view(q.n_actions, -1)
            return
        below = 0
        if len(q.sizes) > 2:
            self._hidden = MLP(q.sizes[:-1])
            below = self._hidden.d
        weights = torch.arange(below, q.d)
        matrix, bias = weights[: -q.n_actions], weights[-q.n_actions :]
        self.last = torch.cat([matrix.view(q.n_actions, -1), bias.unsqueeze(1)], 1)

    def features(self, w: Tensor, x: Tensor) -> Tensor:
        """What those weights multiply, (R, m, B), of weights w (R, 1, d) at prepared x."""
        if self._hidden is None:
            return x
        into = self._hidden.q(w[..., : self._hidden.d], x)[:, 0].relu()
        return torch.cat([into, torch.ones_like(into[:, :1])], 1)
