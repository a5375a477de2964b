"""python -m vtlib.native: compile the kernels, or say why torch will compute instead."""

from vtlib.native.build import compile_kernels, compile_page

try:
    print(f"kernels compiled: {', '.join(path.name for path in compile_kernels())}")
    print(f"for the pages: {compile_page().name}")
except RuntimeError as error:
    print(f"{error}; torch computes instead")
