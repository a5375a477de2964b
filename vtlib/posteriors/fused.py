"""The same update of Cholesky factors in C++: memory is passed once, for a step and samples."""

from __future__ import annotations

import ctypes

import torch
from torch import Tensor

from vtlib.native import kernels
from vtlib.posteriors.base import FactorPosterior
from vtlib.posteriors.dense import start_factors
from vtlib.priors import Start

LANES = 16  # the kernel's rows are padded to a multiple of this
MOST_SAMPLES = LANES
LARGEST = 3e38  # stands for no clipping


class _Descent(ctypes.Structure):
    """As ``Descent`` in native/factor.h."""

    _fields_ = [
        *((name, ctypes.c_int32) for name in ("d", "n_samples", "sources", "diagonal")),
        *((name, ctypes.c_float) for name in ("alpha", "sigma_min", "clip", "kl_clip", "scale")),
    ]


class Fused(FactorPosterior):
    """Lower-triangular factors of M Gaussians under plain SGD, as `Dense`, on the processor.

    A step waits until the next samples are drawn, for these read the same memory. Of L only the
    lower triangle is stored.
    """

    def _start(self, start: Start) -> None:
        runs, components, d = start.mu.shape
        self._kernel = kernels()
        self._kernel.posterior_size.restype = ctypes.c_int64
        self._L = torch.zeros(runs * components, self._kernel.posterior_size(d))
        if start.spread is None:
            self._pack(start_factors(start._replace(mu=start.mu[:1, :1])), 0)
            self._L[1:] = self._L[0]
        else:
            for run in range(runs):
                one = start._replace(mu=start.mu[run : run + 1], spread=start.spread[run : run + 1])
                self._pack(start_factors(one), run * components)
        self._waiting: tuple[Tensor, Tensor, float] | None = None
        self._set_precision(components, d)

    def _pack(self, factors: Tensor, first: int) -> None:
        """Take over factors (m, d, d) of the members from a first one on."""
        d = factors.shape[-1]
        factors.diagonal(dim1=1, dim2=2).clamp_(min=self._sigma_min)
        for m, factor in enumerate(factors):
            self._kernel.posterior_pack(d, _at(factor), _at(self._L[first + m]))

    def _set_precision(self, components: int, d: int) -> None:
        scale, W = self._precision
        sources = 0 if W is None else W.shape[2]
        wide = -(-d // LANES) * LANES
        self._W = torch.zeros(len(self._L), sources, wide)
        self._WL = torch.zeros_like(self._W)  # W^T L, which each product computes
        if W is not None:
            self._W[..., :d] = W.mT.repeat_interleave(components, 0)
        self._descent = _Descent(
            d=d,
            sources=sources,
            diagonal=self._kl == "diagonal",
            alpha=self._alpha,
            sigma_min=self._sigma_min,
            clip=min(self._clip, LARGEST),
            kl_clip=min(self._kl_clip, LARGEST),
            scale=scale,
        )

    def _unpacked(self, m: int, d: int) -> Tensor:
        factor = torch.zeros(d, d)
        self._kernel.posterior_unpack(d, _at(factor), _at(self._L[m]))
        return factor

    def _factors(self) -> Tensor:
        if self._waiting is not None:
            self._product(torch.zeros(len(self._L), 0, self._descent.d))
        return torch.stack([self._unpacked(m, self._descent.d) for m in range(len(self._L))])

    def _descend(self, gradients: Tensor, z: Tensor, kl_weight: float) -> None:
        if self._waiting is not None:
            self._product(z[:, :0])
        self._waiting = gradients.contiguous(), z.contiguous(), kl_weight

    def _product(self, z: Tensor) -> Tensor:
        out, noise = torch.empty_like(z), z.contiguous()
        gradients, used, kl_weight = self._waiting or (noise[:, :0], noise[:, :0], 0.0)
        self._descent.n_samples = gradients.shape[1]
        self._kernel.posterior_step(
            ctypes.byref(self._descent),
            *(len(z), z.shape[1]),
            *map(_at, (self._L, self._W, self._WL, gradients, used, noise, out)),
            ctypes.c_float(kl_weight),
            self._waiting is not None,
        )
        self._waiting = None
        return out


def _at(tensor: Tensor) -> ctypes.c_void_p:
    return ctypes.c_void_p(tensor.data_ptr())
