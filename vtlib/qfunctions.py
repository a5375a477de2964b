"""Q-functions over a flat weight vector: multilayer perceptrons, and any torch module.

Weights are (R, K, d): K weight vectors for each of R runs. Observations are (R, B, obs_dim) and
shared by the K vectors. Values come as (R, K, A, B), actions before states.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor, nn
from torch.func import functional_call, vjp, vmap

from vtlib.checks import check_kind, check_whole, shown


@runtime_checkable
class QFunction(Protocol):
    """What the algorithms need of a Q-function."""

    d: int
    n_actions: int
    width: int  # the most numbers that any layer makes of one observation

    def prepare(self, obs: Tensor) -> Tensor:
        """What can be computed from observations (R, B, obs_dim) before weights are known."""

    def q(self, w: Tensor, x: Tensor) -> Tensor:
        """Values (R, K, A, B) of weights (R, K, d) at prepared observations (R, B, ...)."""

    def vjp(self, w: Tensor, x: Tensor) -> tuple[Tensor, Callable[[Tensor], Tensor]]:
        """Values, and the map from a cotangent (R, K, A, B) to a gradient (R, K, d)."""


def greedy(q: QFunction, w: Tensor, obs: Tensor) -> Tensor:
    """Best actions (R,) by weights (R, 1, d) at one observation (R, obs_dim) of each run."""
    return q.q(w, q.prepare(obs.unsqueeze(1)))[:, 0, :, 0].argmax(-1)


class MLP:
    """Multilayer perceptron with ReLU units; sizes lists the layers, e.g. (4, 32, 2).

    The flat weight vector holds, layer by layer, the matrix (out, in) and then the bias (out).
    """

    def __init__(self, sizes: Sequence[int]) -> None:
        if not isinstance(sizes, Sequence) or len(sizes) < 2:
            raise ValueError(f"sizes must list at least two layer sizes, got {shown(sizes)}")
        for size in sizes:
            check_whole("each of sizes", size)
        self.sizes = tuple(map(int, sizes))
        self._layers = list(pairwise(self.sizes))
        self.n_actions, self.width = self.sizes[-1], max(self.sizes)
        self.d = sum(out * (into + 1) for into, out in self._layers)

    def prepare(self, obs: Tensor) -> Tensor:
        """Observations (R, B, obs_dim) as columns (R, obs_dim + 1, B) that end in a one."""
        check_observations(obs, self._layers[0][0])
        columns = obs.transpose(-1, -2)
        return torch.cat([columns, torch.ones_like(columns[:, :1])], 1)

    def q(self, w: Tensor, x: Tensor) -> Tensor:
        """Values (R, K, A, B) of weights (R, K, d) at prepared observations."""
        values: Tensor = self._forward(w, x)[1][-1].unflatten(0, w.shape[:2])
        return values

    def vjp(self, w: Tensor, x: Tensor) -> tuple[Tensor, Callable[[Tensor], Tensor]]:
        """Values, and the map from a cotangent (R, K, A, B) to a gradient (R, K, d)."""
        matrices, outputs = self._forward(w, x)
        backward = _shallow_gradients if len(matrices) == 2 else _gradients

        def pullback(cotangent: Tensor) -> Tensor:
            parts = backward(matrices, outputs, cotangent.flatten(0, 1))
            return torch.cat([part.flatten(1) for part in parts], -1).view(w.shape)

        return outputs[-1].unflatten(0, w.shape[:2]), pullback

    def _forward(self, w: Tensor, x: Tensor) -> tuple[list[Tensor], list[Tensor]]:
        """Each layer's matrix, and what each layer passes on, of all R * K networks.

        The input comes first; the first matrix has the bias as its last column.
        """
        runs, k, _ = w.shape
        flat = w.reshape(runs * k, -1)
        outputs = [x.unsqueeze(1).expand(-1, k, -1, -1).reshape(runs * k, *x.shape[1:])]
        matrices: list[Tensor] = []
        at = 0
        for into, out in self._layers:
            matrix = flat[:, at : at + out * into].unflatten(-1, (out, into))
            bias = flat[:, at + out * into : at + out * (into + 1)].unsqueeze(-1)
            if matrices:
                x = torch.baddbmm(bias, matrix, outputs[-1].relu_())
            else:
                matrix = torch.cat([matrix, bias], -1)
                x = torch.bmm(matrix, outputs[-1])
            matrices.append(matrix)
            outputs.append(x)
            at += out * (into + 1)
        return matrices, outputs


def check_observations(obs: Tensor, size: int) -> None:
    """Raise ValueError unless observations (..., size) have so many numbers."""
    if obs.shape[-1] != size:
        need = f"observations must have {size} numbers for this Q-function"
        raise ValueError(f"{need}, got {obs.shape[-1]}")


def _gradients(matrices: list[Tensor], outputs: list[Tensor], delta: Tensor) -> list[Tensor]:
    """Backpropagation: gradients of matrix and bias layer by layer, from a cotangent (N, A, B)."""
    parts: list[Tensor] = []
    for layer in range(len(matrices) - 1, 0, -1):
        into = outputs[layer]
        parts = [torch.bmm(delta, into.transpose(1, 2)), delta.sum(-1), *parts]
        # the sign of a ReLU's output is its derivative, and faster to compute than a mask
        delta = torch.bmm(matrices[layer].transpose(1, 2), delta).mul_(into.sign())
    first = torch.bmm(delta, outputs[0].transpose(1, 2))
    return [first[..., :-1], first[..., -1], *parts]


def _shallow_gradients(
    matrices: list[Tensor], outputs: list[Tensor], cotangent: Tensor
) -> list[Tensor]:
    """The same for one hidden layer, from one product with the mask of its units that are on.

    A unit's output is its mask times a linear function of the input x, so both layers' gradients
    are contractions of sum_b cotangent_ab mask_hb x_ib, and the hidden layer is read once.
    """
    first, second = matrices
    mask = outputs[1].sign()
    outer = (cotangent.unsqueeze(2) * outputs[0].unsqueeze(1)).flatten(1, 2)
    shape = (-1, second.shape[1], *first.transpose(1, 2).shape[1:])
    moments = torch.bmm(outer, mask.transpose(1, 2)).view(shape)  # (N, A, in + 1, hidden)
    into_second = (moments * first.transpose(1, 2).unsqueeze(1)).sum(2)
    into_first = (moments * second.unsqueeze(2)).sum(1).transpose(1, 2)
    return [into_first[..., :-1], into_first[..., -1], into_second, cotangent.sum(-1)]


class ModuleQ:
    """Any torch.nn.Module from observations (B, obs_dim) to values (B, A), by torch.func.

    The module's parameters, flattened in the order of ``named_parameters``, are the weights, but
    for those that require no gradient, which stay as they are; the module itself is only read.
    Slower than by hand. Raises ValueError for buffers, or nothing to train.
    """

    def __init__(self, module: nn.Module, n_actions: int) -> None:
        check_whole("n_actions", n_actions)
        check_kind("module", module, nn.Module)
        if buffers := [name for name, _ in module.named_buffers()]:
            raise ValueError(f"module must have no buffers, it has {', '.join(buffers)}")
        self.n_actions = int(n_actions)
        self._module = module
        trained = [(name, p) for name, p in module.named_parameters() if p.requires_grad]
        self._shapes = {name: p.shape for name, p in trained}
        if not self._shapes:
            raise ValueError("module must have parameters that require gradients, it has none")
        self.width = max(shape[:1].numel() for shape in self._shapes.values())
        self.d = sum(shape.numel() for shape in self._shapes.values())

    def flatten(self, module: nn.Module) -> Tensor:
        """The weights (d,) of a module of the same shape, such as a solved source's network."""
        check_kind("module", module, nn.Module)
        parts = dict(module.named_parameters())
        own = {name: p.shape for name, p in parts.items() if name in self._shapes}
        if own != self._shapes:
            need = ", ".join(f"{name} {tuple(shape)}" for name, shape in self._shapes.items())
            raise ValueError(f"module must have the parameters {need}, got {shown(module)}")
        return torch.cat([parts[name].detach().reshape(-1).float() for name in self._shapes])

    def prepare(self, obs: Tensor) -> Tensor:
        """Observations as they are."""
        return obs

    def q(self, w: Tensor, x: Tensor) -> Tensor:
        """Values (R, K, A, B) of weights (R, K, d) at observations (R, B, obs_dim)."""
        return vmap(vmap(self._single, (0, None)))(w, x)

    def vjp(self, w: Tensor, x: Tensor) -> tuple[Tensor, Callable[[Tensor], Tensor]]:
        """Values, and the map from a cotangent (R, K, A, B) to a gradient (R, K, d)."""
        # torch cannot say that it returns a pair unless it is asked for more
        values, pullback = vjp(lambda weights: self.q(weights, x), w)  # type: ignore[misc]
        return values, lambda cotangent: pullback(cotangent)[0]

    def _single(self, w: Tensor, x: Tensor) -> Tensor:
        parts = w.split([shape.numel() for shape in self._shapes.values()])
        named = {
            name: part.view(shape)
            for (name, shape), part in zip(self._shapes.items(), parts, strict=True)
        }
        values: Tensor = functional_call(self._module, named, (x,))
        return values.transpose(-1, -2)
