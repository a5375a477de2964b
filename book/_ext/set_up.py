"""Set up the environment that make works in, and say so where that fails.

``python3.11 book/_ext/set_up.py .venv book kernels checks`` does what is missing of these parts. A
part is done again when the files that it is made of have changed, all parts when the environment
was made in another folder or is broken. Only Python's standard library is needed.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
CPU_TORCH = "https://download.pytorch.org/whl/cpu"
PARTS = {  # what each is made of
    "book": ("requirements.txt", "pyproject.toml", "book/pyproject.toml"),
    "kernels": ("vtlib/native/*.*", "book/vtlab/native/*.*"),
    "checks": ("requirements-checks.txt",),
}


def run(*command: str, **streams: Any) -> bool:
    """Run a command, which writes itself what fails; whether it ends well."""
    return subprocess.run(command, cwd=ROOT, check=False, **streams).returncode == 0


def create(folder: Path) -> None:
    """Make an environment with pip, in place of one that is broken or was made elsewhere."""
    if folder.exists() and not (folder / "pyvenv.cfg").exists():
        raise SystemExit(f"{folder} is no Python environment: remove it, or name another VENV")
    print(f"==> Setting up {folder} (once): about 2 minutes, 1.5 GB", flush=True)
    if not run(sys.executable, "-m", "venv", "--clear", str(folder)):
        raise SystemExit(
            f"{sys.executable} cannot make an environment with pip: it needs the modules venv and "
            "ensurepip (on Debian: apt install python3.11-venv)"
        )


def pip(python: str, *arguments: str, **streams: Any) -> bool:
    """Install into the environment, even where the user's settings name the user's own folder."""
    options = ("-qq", "--disable-pip-version-check", "--no-user")  # errors alone are shown
    return run(python, "-m", "pip", "install", *options, *arguments, **streams)


def install(python: str, *arguments: str) -> None:
    """Install what the arguments say; ends the program below pip's own words."""
    if not pip(python, *arguments):
        raise SystemExit(f"pip could not install {arguments[-1]}")


def book(python: str) -> bool:
    """Install what the book needs, and the packages of this checkout in place."""
    print("--> 1 of 3: PyTorch, the build without CUDA", flush=True)
    pinned = (ROOT / "requirements.txt").read_text(encoding="utf-8")
    torch = re.findall(r"^torch==\S+", pinned, re.MULTILINE)
    quick = ("--retries=1", "--timeout=30", "--no-deps", f"--index-url={CPU_TORCH}")
    if not pip(python, *quick, *torch, capture_output=True):
        print("    PyTorch's own index does not give it: the ordinary build is larger")
    print("--> 2 of 3: everything else, with the digests of requirements.txt", flush=True)
    install(python, "--require-hashes", "-r", str(ROOT / "requirements.txt"))
    print("--> 3 of 3: vtlib and the pages' package, in place", flush=True)
    packages = ("-e", str(ROOT), "-e", str(ROOT / "book"))
    install(python, "--no-deps", "--no-build-isolation", *packages)
    return True


def checks(python: str) -> bool:
    """Install linters, test tools and drivers of browsers."""
    print("--> what the checks need, with the digests of requirements-checks.txt", flush=True)
    install(python, "--require-hashes", "-r", str(ROOT / "requirements-checks.txt"))
    return True


def kernels(python: str) -> bool:
    """Compile the loops in C++; False where torch will have to compute instead, which is said."""
    print("--> and the loops in C++, compiled for this machine: a minute or two", flush=True)
    return run(python, "-m", "vtlab.native")


STEPS = {"book": book, "kernels": kernels, "checks": checks}


def digest(patterns: tuple[str, ...]) -> str:
    """A digest of the names and the content of files of the checkout."""
    files = sorted(path for pattern in patterns for path in ROOT.glob(pattern))
    content = b"".join(path.name.encode() + path.read_bytes() for path in files)
    return hashlib.sha256(content).hexdigest()


@contextlib.contextmanager
def alone(lock: Path, work: str) -> Iterator[None]:
    """Hold a lock, which ends with this process; where another holds it, say so and wait."""
    lock.parent.mkdir(exist_ok=True)
    with lock.open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print(f"==> Another command {work}: waiting for it (Ctrl-C is safe)", flush=True)
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def set_up(folder: Path, parts: tuple[str, ...]) -> None:
    """Do what is missing of some parts, in their order, by a note of what was done of what."""
    note, python, done = folder / "set-up.json", folder / "bin" / "python", {}
    with contextlib.suppress(OSError, ValueError):
        done = json.loads(note.read_text())
    if done.get("folder") != str(folder) or not python.exists():
        create(folder)
        done = {"folder": str(folder)}
    for part in parts:
        made_of = digest(PARTS[part])
        if done.get(part) != made_of and STEPS[part](str(python)):
            done[part] = made_of
            note.write_text(json.dumps(done))


def main(folder: str, *parts: str) -> None:
    """Command line."""
    if sys.version_info[:2] != (3, 11):
        raise SystemExit(
            f"Python 3.11 is needed, and {sys.executable} is {sys.version.split()[0]}:\n"
            "make PYTHON=/path/to/python3.11 book"
        )
    (ROOT / "_build" / "home").mkdir(parents=True, exist_ok=True)  # for what tools write at home
    try:
        with alone(ROOT / "_build" / "set-up.lock", "sets up the environment"):
            set_up(Path(os.path.abspath(folder)), parts)
    except KeyboardInterrupt:
        raise SystemExit("Interrupted: the same command goes on.") from None


if __name__ == "__main__":
    main(*sys.argv[1:])
