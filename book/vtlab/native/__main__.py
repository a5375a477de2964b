"""python -m vtlab.native: compile whole runs, or say why the engine will compute them instead.

With `page` it compiles the modules of the pages, page_*.wasm, which the repository holds.
"""

import sys

from vtlab.native.build import PAGES, RUNS, compile_page
from vtlib.native.build import compile_library

page = sys.argv[1:] == ["page"]
try:
    paths = [*map(compile_page, PAGES)] if page else compile_library(RUNS)
    print(f"compiled: {', '.join(path.name for path in paths)}")
except RuntimeError as error:
    sys.exit(f"{error}{'' if page else '; torch computes instead'}")
