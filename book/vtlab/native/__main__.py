"""python -m vtlab.native: compile whole runs, or say why the engine will compute them instead.

With `page` it compiles the kernel of the pages, page.wasm, which the repository holds.
"""

import sys

from vtlab.native.build import RUNS, compile_page
from vtlib.native.build import compile_library

page = sys.argv[1:] == ["page"]
try:
    paths = [compile_page()] if page else compile_library(RUNS)
    print(f"compiled: {', '.join(path.name for path in paths)}")
except RuntimeError as error:
    sys.exit(f"{error}{'' if page else '; torch computes instead'}")
