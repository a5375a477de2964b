"""python -m vtlib.native: compile the kernels, or say why torch will compute instead.

With `page` it compiles the kernel of the pages, page.wasm, which the repository holds.
"""

import sys

from vtlib.native.build import compile_kernels, compile_page

page = sys.argv[1:] == ["page"]
try:
    made = [compile_page()] if page else compile_kernels()
    print(f"compiled: {', '.join(path.name for path in made)}")
except RuntimeError as error:
    if page:
        sys.exit(str(error))
    print(f"{error}; torch computes instead")
