"""The same update for many weights: memory is passed once in a block of iterations."""

import ctypes

import torch
from torch import Tensor

from vtlib.posteriors.native import NativePosterior, at
from vtlib.priors import Start

DRAWS = 96  # noise vectors in a block at most, as in native/blocks.h


class Blocked(NativePosterior):
    """A block's noise is drawn when it begins, and multiplied with L in one pass over its memory.

    The same pass takes in the steps of the block before. Within a block these are outer products
    beside L, but where an entry of a gradient might be clipped L itself is stepped. The precision
    is isotropic, or its diagonal alone is felt.
    """

    _kernel = "blocks"

    def _start(self, start: Start) -> None:
        super()._start(start)
        runs, components, d = start.mu.shape
        self._block, self._t = DRAWS // self._n_samples, -1
        diagonal = self._precision.diagonal(d).expand(runs, d)
        self._diagonal = diagonal.repeat_interleave(components, 0)

    def _draw(self, n: int) -> Tensor:
        self._t = (self._t + 1) % self._block
        if self._t == 0:
            self._noises = torch.stack([self._noise.normal(n) for _ in range(self._block)])
            self._function("begin")(
                *(self._descent.d, len(self._memory), self._block, self._n_samples),
                *map(at, (self._memory, self._noises)),
            )
        return self._noises[self._t]

    def _product(self, z: Tensor) -> Tensor:
        out = torch.empty_like(z)
        place = self._descent.d, len(z), self._t, self._n_samples
        self._function("product")(*place, at(self._memory), at(out))
        return out

    def _descend(self, gradients: Tensor, z: Tensor, kl_weight: float) -> None:
        gradients = gradients.contiguous()
        self._descent.n_samples = gradients.shape[1]
        self._function("step")(
            ctypes.byref(self._descent),
            *(len(gradients), self._t, self._n_samples),
            *map(at, (self._memory, self._diagonal, gradients)),
            ctypes.c_float(kl_weight),
        )
