"""Compiles C++ with Zig's compiler, which is a Python package: no system tools."""

import hashlib
import importlib.util
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parent
POSTERIOR = HERE / "posterior.cpp"
CACHE = HERE / "lib" / ".cache"
# No fast-math: NaN has to reach the check for diverged runs, and positions round as in torch.
FLAGS = ("-O3", "-ffp-contract=on", "-fno-math-errno", "-fno-exceptions", "-fno-rtti")
# Clang would split wide registers, which slowed the first processors that had them.
WIDE = {"x86_64_v4": ("-mprefer-vector-width=512",)}
# What to compile for, best first, and what processors have that can run it, as torch calls it.
ANY = ("AVX512", "AVX2", "DEFAULT", "NO AVX", "SVE256", "ZVECTOR", "VSX")
LEVELS = {"x86_64_v4": ANY[:1], "x86_64_v3": ANY[:2], "baseline": ANY}
SYSTEMS = {"Linux": ("linux-gnu", "so"), "Darwin": ("macos", "dylib")}


def library(source: Path, level: str) -> Path:
    """Where a source's library for processors of a level is, or will be.

    Its name has a digest of the C++ beside the source, and this folder's, and the flags, so that a
    library of older sources is never loaded.
    """
    _, suffix = SYSTEMS.get(platform.system(), ("", ""))
    beside = {path for folder in (HERE, source.parent) for path in folder.iterdir()}
    files = sorted(path for path in beside if path.suffix in (".cpp", ".h"))
    content = b"".join(path.name.encode() + path.read_bytes() for path in files)
    digest = hashlib.sha256(repr((FLAGS, WIDE)).encode() + content).hexdigest()[:12]
    return source.parent / "lib" / f"{source.stem}-{level}-{digest}.{suffix}"


def compile_library(source: Path) -> list[Path]:
    """Compile a source for this kind of machine; raises RuntimeError where that cannot be."""
    if importlib.util.find_spec("ziglang") is None:
        raise RuntimeError("the kernels need a compiler: pip install 'vtlib[native]' brings one")
    try:
        system, machine = SYSTEMS[platform.system()][0], platform.machine()
        cpu = {"AMD64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
        levels = tuple(LEVELS) if cpu == "x86_64" else ("baseline",)
        target, flags = f"{cpu}-{system}", ["-shared", "-fPIC"]
        made = [library(source, level) for level in levels]
        for level, path in zip(levels, made, strict=True):
            if not path.exists():
                compile_source(source, path, target, level, flags)
    except (KeyError, OSError, subprocess.SubprocessError) as error:
        lines = str(getattr(error, "stderr", None) or error).strip().splitlines()
        last = ([line for line in lines if "error:" in line] or lines or [repr(error)])[-1]
        raise RuntimeError(f"the kernels cannot be compiled here: {last}") from error
    return made


def compile_source(
    source: Path, out: Path, target: str, cpu: str, flags: Sequence[str] = ()
) -> Path:
    """Compile a source for a target and a processor; what a failing compiler raises, it raises."""
    out.parent.mkdir(exist_ok=True)
    # The compiler keeps its cache here, because a home may be missing or not be writable.
    env = dict.fromkeys(("ZIG_LOCAL_CACHE_DIR", "ZIG_GLOBAL_CACHE_DIR"), str(CACHE)) | os.environ
    with tempfile.TemporaryDirectory(dir=out.parent) as folder:
        new = Path(folder) / out.name
        command = [sys.executable, "-m", "ziglang", "c++", "-target", target, f"-mcpu={cpu}"]
        command += [*FLAGS, f"-I{HERE}", *WIDE.get(cpu, ()), *flags, "-o", str(new), str(source)]
        subprocess.run(command, check=True, capture_output=True, text=True, timeout=300, env=env)
        new.replace(out)  # at once: a process that loads it meanwhile has the old one or the new
    return out
