"""Cholesky factors that live in memory of the kernels in C++."""

import ctypes
from typing import Any, ClassVar

import torch
from torch import Tensor

from vtlib.native import kernels
from vtlib.posteriors.base import Posterior
from vtlib.posteriors.dense import start_factors
from vtlib.priors import Start

MOST_SAMPLES = 16  # lanes of the kernels
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


def at(tensor: Tensor) -> ctypes.c_void_p:
    """Where a tensor lies, which must outlive the call of a kernel."""
    return ctypes.c_void_p(tensor.data_ptr())
