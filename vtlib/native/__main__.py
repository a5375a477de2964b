"""python -m vtlib.native: compile the kernels, or say why torch will compute instead."""

import sys

from vtlib.native.build import POSTERIOR, compile_library

try:
    print(f"compiled: {', '.join(path.name for path in compile_library(POSTERIOR))}")
except RuntimeError as error:
    sys.exit(f"{error}; torch computes instead")
