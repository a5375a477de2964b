"""The posterior's steps in C++, compiled for this machine when the project is set up.

What is not compiled is not used: torch computes the same, up to rounding.
"""

import ctypes
import functools
from pathlib import Path
from typing import Any

import torch

from vtlib.native.build import LEVELS, POSTERIOR, library


@functools.cache
def level(source: Path = POSTERIOR) -> str | None:
    """Which of a source's libraries suits this processor best; None where none was compiled."""
    has = torch.backends.cpu.get_cpu_capability()
    fits = (x for x, needed in LEVELS.items() if has in needed and library(source, x).exists())
    return next(fits, None)


@functools.cache
def kernels(source: Path = POSTERIOR) -> Any:
    """A source's library of that level; None where there is none."""
    best = level(source)
    return best and ctypes.CDLL(str(library(source, best)))
