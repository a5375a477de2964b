"""Compiles whole runs, for this machine and for the pages."""

import subprocess
from pathlib import Path

from vtlib.native.build import compile_source

HERE = Path(__file__).resolve().parent
RUNS = HERE / "runs.cpp"
# What a page calls, in the order of page.cpp. There size counts, and speed suffers little by it.
PAGE = HERE / "page.wasm"
EXPORTS = ("place", "begin_run", "iterate_run", "learning", "unpack", "greedy")


def compile_page(out: Path = PAGE) -> Path:
    """Compile the rooms for a browser, to the same bytes on every machine.

    Raises RuntimeError where that cannot be.
    """
    linker = ["--no-entry", "--strip-all", *(f"--export={name}" for name in EXPORTS)]
    flags = ["-Os", "-nostdlib", *(f"-Wl,{option}" for option in linker)]
    try:
        return compile_source(
            HERE / "page.cpp", out, "wasm32-freestanding", "generic+simd128", flags
        )
    except (OSError, subprocess.SubprocessError) as error:
        raise RuntimeError(f"the page's kernel cannot be compiled here: {error}") from error
