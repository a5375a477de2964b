"""The inner loops in C++, compiled for this machine when the project is set up.

What is not compiled is not used: torch computes the same, up to rounding.
"""

from __future__ import annotations

import ctypes
import functools
from typing import Any

import torch

from vtlib.native.build import LEVELS, library


@functools.cache
def kernels() -> Any:
    """The compiled kernels that suit this processor best; None where they were not compiled."""
    capability = torch.backends.cpu.get_cpu_capability()
    for level, needed in LEVELS.items():
        if library(level).exists() and capability in needed:
            return ctypes.CDLL(str(library(level)))
    return None
