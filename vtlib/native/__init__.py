"""The inner loops in C++, compiled for this machine when the project is set up.

What is not compiled is not used: torch computes the same, up to rounding.
"""

import ctypes
import functools
from typing import Any

import torch

from vtlib.native.build import LEVELS, library


@functools.cache
def level() -> str | None:
    """Which of the compiled kernels suits this processor best; None where none was compiled."""
    capability = torch.backends.cpu.get_cpu_capability()
    fits = (x for x, needed in LEVELS.items() if library(x).exists() and capability in needed)
    return next(fits, None)


@functools.cache
def kernels() -> Any:
    """The compiled kernels of that level; None where there are none."""
    best = level()
    return best and ctypes.CDLL(str(library(best)))
