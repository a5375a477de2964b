"""python -m vtlab.native: compile the loops in C++, or say why torch will compute instead.

With `page` it compiles the modules of the pages, page_*.wasm, which the repository holds.
"""

import sys

from vtlab.native.build import PAGES, RUNS, compile_page
from vtlib.native.build import POSTERIOR, compile_library

page = sys.argv[1:] == ["page"]
try:
    libraries = () if page else (POSTERIOR, RUNS)
    paths = [path for source in libraries for path in compile_library(source)]
    paths += [compile_page(kernel) for kernel in PAGES if page]
    print(f"compiled: {', '.join(path.name for path in paths)}")
except RuntimeError as error:
    sys.exit(f"{error}{'' if page else '; torch computes instead'}")
