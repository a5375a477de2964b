"""The same update of Cholesky factors in C++: memory is passed once, for a step and samples."""

import ctypes

import torch
from torch import Tensor

from vtlib.posteriors.native import NativePosterior, at
from vtlib.priors import Start

LANES = 16  # the kernel's rows are padded to a multiple of this


class Fused(NativePosterior):
    """A step waits until the next samples are drawn, for these read the same memory."""

    _kernel = "posterior"

    def _start(self, start: Start) -> None:
        super()._start(start)
        _, components, d = start.mu.shape
        self._waiting: tuple[Tensor, Tensor, float] | None = None
        wide = -(-d // LANES) * LANES
        self._W = torch.zeros(len(self._memory), self._descent.sources, wide)
        self._WL = torch.zeros_like(self._W)  # W^T L, which each product computes
        if self._precision.W is not None:
            self._W[..., :d] = self._precision.W.mT.repeat_interleave(components, 0)

    def _factors(self) -> Tensor:
        if self._waiting is not None:
            self._product(torch.zeros(len(self._memory), 0, self._descent.d))
        return super()._factors()

    def _descend(self, gradients: Tensor, z: Tensor, kl_weight: float) -> None:
        if self._waiting is not None:
            self._product(z[:, :0])
        self._waiting = gradients.contiguous(), z.contiguous(), kl_weight

    def _product(self, z: Tensor) -> Tensor:
        out, noise = torch.empty_like(z), z.contiguous()
        gradients, before, kl_weight = self._waiting or (noise[:, :0], noise[:, :0], 0.0)
        self._descent.n_samples = gradients.shape[1]
        arrays = self._memory, self._W, self._WL, gradients, before, noise, out
        self._function("step")(
            ctypes.byref(self._descent),
            *(len(z), z.shape[1]),
            *map(at, arrays),
            ctypes.c_float(kl_weight),
            self._waiting is not None,
        )
        self._waiting = None
        return out
