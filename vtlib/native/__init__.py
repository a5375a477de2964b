"""The posterior's steps in C++, compiled for this machine at set-up or when first asked for.

What is not compiled is not used: torch computes the same, up to rounding.
"""

import ctypes
import functools
import importlib.util
import logging
from pathlib import Path
from typing import Any

import torch

from vtlib.native.build import LEVELS, POSTERIOR, compile_library, library

LOGGER = logging.getLogger("vtlib")


@functools.cache
def level(source: Path = POSTERIOR) -> str | None:
    """Which of a source's libraries suits this processor best; None where none was compiled."""
    has = torch.backends.cpu.get_cpu_capability()
    fits = (x for x, needed in LEVELS.items() if has in needed and library(source, x).exists())
    return next(fits, None)


@functools.cache
def kernels(source: Path = POSTERIOR) -> Any:
    """A source's library of that level, compiled now if need be; None where that cannot be."""
    if level(source) is None:
        if importlib.util.find_spec("ziglang") is not None:
            LOGGER.warning("compiling the loops in C++ for this machine, once: some minutes")
        try:
            compile_library(source)
            level.cache_clear()
        except RuntimeError as error:
            LOGGER.warning("%s; torch computes instead, slower with many weights", error)
    best = level(source)
    return best and ctypes.CDLL(str(library(source, best)))
