"""Compiles whole runs, for this machine and for the pages."""

import subprocess
from pathlib import Path

from vtlib.native.build import compile_source

HERE = Path(__file__).resolve().parent
RUNS = HERE / "runs.cpp"
# The pages' modules, by the names of the kernels: each is page.cpp for a task of its own.
PAGES = {"rooms": "Rooms", "cartpole": "Cartpole", "mountain_car": "MountainCar"}
CALLS = "place begin_run iterate_run learning earned promise unpack step_stage"  # as in page.cpp


def page_module(kernel: str) -> Path:
    """Where the module of a kernel's tasks is, which a page holds a copy of."""
    return HERE / f"page_{kernel}.wasm"


def compile_page(kernel: str, out: Path | None = None) -> Path:
    """Compile a kernel's tasks for a browser, to the same bytes on every machine.

    Size counts there, and speed suffers little by it. Raises RuntimeError where that cannot be.
    """
    linker = ["--no-entry", "--strip-all", *(f"--export={name}" for name in CALLS.split())]
    flags = ["-Os", "-nostdlib", f"-DTASK={PAGES[kernel]}", *(f"-Wl,{option}" for option in linker)]
    source, out = HERE / "page.cpp", out or page_module(kernel)
    try:
        return compile_source(source, out, "wasm32-freestanding", "generic+simd128", flags)
    except (OSError, subprocess.SubprocessError) as error:
        raise RuntimeError(f"the page's kernel cannot be compiled here: {error}") from error
