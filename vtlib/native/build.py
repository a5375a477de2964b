"""Compiles the kernels with Zig's C++ compiler, which is a Python package: no system tools."""

import platform
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
LIBRARIES = HERE / "lib"
# No fast-math: NaN has to reach the check for diverged runs, and positions round as in torch.
FLAGS = ("-O3", "-ffp-contract=on", "-fno-math-errno", "-fno-exceptions", "-fno-rtti")
# Clang would split wide registers, which slowed the first processors that had them.
WIDE = {"x86_64_v4": ("-mprefer-vector-width=512",)}
# What to compile for, best first, and what processors have that can run it, as torch calls it.
ANY = ("AVX512", "AVX2", "DEFAULT", "NO AVX", "SVE256", "ZVECTOR", "VSX")
LEVELS = {"x86_64_v4": ANY[:1], "x86_64_v3": ANY[:2], "baseline": ANY}
# What a page calls, in the order of page.cpp. There size counts, and speed suffers little by it.
PAGE = HERE / "page.wasm"
EXPORTS = ("place", "begin_run", "iterate_run", "learning", "unpack", "greedy")
SYSTEMS = {"Linux": ("linux-gnu", "so"), "Darwin": ("macos", "dylib")}


def library(level: str) -> Path:
    """Where the kernels for processors of a level are, or will be; nowhere on other systems."""
    _, suffix = SYSTEMS.get(platform.system(), ("", ""))
    return LIBRARIES / f"kernel-{level}.{suffix}"


def compile_kernels() -> list[Path]:
    """Compile the kernels for this kind of machine; raises RuntimeError where that cannot be."""
    try:
        system, machine = SYSTEMS[platform.system()][0], platform.machine()
        cpu = {"AMD64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
        levels = tuple(LEVELS) if cpu == "x86_64" else ("baseline",)
        LIBRARIES.mkdir(exist_ok=True)
        return [_compile(level, f"{cpu}-{system}") for level in levels]
    except (KeyError, OSError, subprocess.SubprocessError) as error:
        raise RuntimeError(f"the kernels cannot be compiled here: {error}") from error


def compile_page(out: Path = PAGE) -> Path:
    """Compile the rooms for a browser, to the same bytes on every machine; raises as above."""
    linker = ["--no-entry", "--strip-all", *(f"--export={name}" for name in EXPORTS)]
    flags = ["-Os", "-nostdlib", *(f"-Wl,{option}" for option in linker)]
    try:
        return _run("page.cpp", out, "wasm32-freestanding", "generic+simd128", flags)
    except (OSError, subprocess.SubprocessError) as error:
        raise RuntimeError(f"the page's kernel cannot be compiled here: {error}") from error


def _compile(level: str, target: str) -> Path:
    return _run("kernel.cpp", library(level), target, level, ["-shared", "-fPIC"])


def _run(source: str, out: Path, target: str, cpu: str, flags: list[str]) -> Path:
    with tempfile.TemporaryDirectory(dir=out.parent) as folder:
        new = Path(folder) / out.name
        command = [sys.executable, "-m", "ziglang", "c++", "-target", target, f"-mcpu={cpu}"]
        command += [*FLAGS, *WIDE.get(cpu, ()), *flags, "-o", str(new), str(HERE / source)]
        subprocess.run(command, check=True, capture_output=True, text=True, timeout=300)
        new.replace(out)  # at once: a process that loads it meanwhile has the old one or the new
    return out
