"""The same update for many weights: memory is passed once in a block of iterations."""

from __future__ import annotations

import ctypes

import torch
from torch import Tensor

from vtlib.native import kernels
from vtlib.posteriors.base import FactorPosterior
from vtlib.posteriors.dense import start_factors
from vtlib.posteriors.fused import LARGEST, _at, _Descent
from vtlib.priors import Start

DRAWS = 96  # noise vectors in a block, at most


class Blocked(FactorPosterior):
    """Lower-triangular factors of M Gaussians under plain SGD, as `Dense`, on the processor.

    The noise of a block of iterations is drawn when it begins, and multiplied with L in one pass,
    which also takes in the steps of the block before. Within a block L is a factor and outer
    products, unless an entry of a gradient might be clipped. The precision is isotropic, or its
    diagonal alone is felt.
    """

    def _start(self, start: Start) -> None:
        runs, components, d = start.mu.shape
        self._kernel = kernels()
        self._kernel.blocks_size.restype = ctypes.c_int64
        self._memory = torch.zeros(runs * components, self._kernel.blocks_size(d))
        if start.spread is None:
            self._pack(start_factors(start._replace(mu=start.mu[:1, :1])), 0)
            self._memory[1:] = self._memory[0]
        else:
            for run in range(runs):
                one = start._replace(mu=start.mu[run : run + 1], spread=start.spread[run : run + 1])
                self._pack(start_factors(one), run * components)
        self._block, self._t = DRAWS // self._n_samples, -1
        diagonal = self._precision.diagonal(d).expand(runs, d)
        self._diagonal = diagonal.repeat_interleave(components, 0).contiguous()
        self._descent = _Descent(
            d=d,
            diagonal=self._kl == "diagonal",
            alpha=self._alpha,
            sigma_min=self._sigma_min,
            clip=min(self._clip, LARGEST),
            kl_clip=min(self._kl_clip, LARGEST),
            scale=self._precision.scale,
        )

    def _pack(self, factors: Tensor, first: int) -> None:
        """Take over factors (m, d, d) of the members from a first one on."""
        d = factors.shape[-1]
        factors.diagonal(dim1=1, dim2=2).clamp_(min=self._sigma_min)
        for m, factor in enumerate(factors):
            self._kernel.blocks_pack(d, _at(factor), _at(self._memory[first + m]))

    def _factors(self) -> Tensor:
        d = self._descent.d
        factors = torch.zeros(len(self._memory), d, d)
        for factor, memory in zip(factors, self._memory, strict=True):
            settled = memory.clone()
            self._kernel.blocks_unpack(d, _at(factor), _at(settled))
        return factors

    def _draw(self, n: int) -> Tensor:
        self._t = (self._t + 1) % self._block
        if self._t == 0:
            self._ahead = torch.stack([self._noise.normal(n) for _ in range(self._block)])
            self._kernel.blocks_begin(
                *(self._descent.d, len(self._memory), self._block, self._n_samples),
                *map(_at, (self._memory, self._ahead)),
            )
        return self._ahead[self._t]

    def _product(self, z: Tensor) -> Tensor:
        out = torch.empty_like(z)
        self._kernel.blocks_product(
            *(self._descent.d, len(z), self._t, self._n_samples), _at(self._memory), _at(out)
        )
        return out

    def _descend(self, gradients: Tensor, z: Tensor, kl_weight: float) -> None:
        self._descent.n_samples, gradients = gradients.shape[1], gradients.contiguous()
        self._kernel.blocks_step(
            ctypes.byref(self._descent),
            *(len(gradients), self._t, self._n_samples),
            *map(_at, (self._memory, self._diagonal, gradients)),
            ctypes.c_float(kl_weight),
        )
