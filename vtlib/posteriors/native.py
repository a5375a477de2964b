"""Posteriors with a full covariance in C++: the update of `Dense`, in fewer passes of memory."""

import ctypes
from typing import Any, ClassVar

import torch
from torch import Tensor

from vtlib.native import kernels
from vtlib.posteriors.base import Posterior
from vtlib.posteriors.dense import start_factors
from vtlib.priors import Start

MOST_SAMPLES = 16  # lanes of the kernels, of which rows are padded to a multiple
DRAWS = 96  # noise vectors in a block at most, as in native/blocks.h
LARGEST = 3e38  # stands for no clipping


class _Descent(ctypes.Structure):
    """As ``Descent`` in native/factor.h."""

    _fields_ = [
        *((name, ctypes.c_int32) for name in ("d", "n_samples", "sources", "diagonal")),
        *((name, ctypes.c_float) for name in ("alpha", "sigma_min", "clip", "kl_clip", "scale")),
    ]


class NativePosterior(Posterior):
    """`Dense` on the processor; of L only the lower triangle is stored."""

    _kernel: ClassVar[str]  # what the kernel's functions are called

    def _start(self, start: Start) -> None:
        runs, components, d = start.mu.shape
        size = self._function("size")
        size.restype = ctypes.c_int64
        self._memory = torch.zeros(runs * components, size(d))
        for run in range(runs if start.spread is not None else 1):
            spread = None if start.spread is None else start.spread[run : run + 1]
            component = Start(start.mu[run : run + 1, :1], start.variance, spread)
            factor = start_factors(component, self._sigma_min)[0]
            copies = self._memory[run * components :]
            self._function("pack")(d, at(factor), at(copies))
            copies[1 : components if start.spread is not None else None] = copies[0]
        W = self._precision.W
        self._descent = _Descent(
            d=d,
            sources=0 if W is None else W.shape[2],
            diagonal=self._kl == "diagonal",
            alpha=self._alpha,
            sigma_min=self._sigma_min,
            clip=min(self._clip, LARGEST),
            kl_clip=min(self._kl_clip, LARGEST),
            scale=self._precision.scale,
        )

    def _factors(self) -> Tensor:
        d = self._descent.d
        factors = torch.zeros(len(self._memory), d, d)
        for factor, memory in zip(factors, self._memory, strict=True):
            copy = memory.clone()  # the kernel may change it
            self._function("unpack")(d, at(factor), at(copy))
        return factors

    def _function(self, name: str) -> Any:
        return getattr(kernels(), f"{self._kernel}_{name}")


class Fused(NativePosterior):
    """A step waits until the next samples are drawn, for these read the same memory."""

    _kernel = "posterior"

    def _start(self, start: Start) -> None:
        super()._start(start)
        _, components, d = start.mu.shape
        self._waiting: tuple[Tensor, Tensor, float] | None = None
        wide = -(-d // MOST_SAMPLES) * MOST_SAMPLES
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


class Blocked(NativePosterior):
    """For many weights: a block's noise is drawn when it begins, and multiplied with L in one pass.

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


def at(tensor: Tensor) -> ctypes.c_void_p:
    """Where a tensor lies, which must outlive the call of a kernel."""
    return ctypes.c_void_p(tensor.data_ptr())
