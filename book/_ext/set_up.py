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
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
STATE = "set-up.json"  # in the environment: where it was made, and of what
CPU_TORCH = "https://download.pytorch.org/whl/cpu"
NETWORK = {"index-url", "extra-index-url", "trusted-host", "proxy", "no-index", "find-links"}
NETWORK |= {"cert", "client-cert"}
PARTS = {  # what each is made of
    "book": ("requirements.txt", "pyproject.toml", "book/pyproject.toml"),
    "kernels": (
        *("vtlib/native/*.cpp", "vtlib/native/*.h", "vtlib/native/build.py"),
        *("book/vtlab/native/*.cpp", "book/vtlab/native/*.h"),
    ),
    "checks": ("requirements-checks.txt",),
}


class Failed(RuntimeError):
    """A part could not be set up; the text says why."""


class Environment:
    """A virtual environment, and what has been done in it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.python = folder, str(folder / "bin" / "python")
        self.options: list[str] = []  # for pip: how the user reaches the network

    def done(self) -> dict[str, str]:
        """Digests of the parts that are set up; none where the environment was made elsewhere."""
        with contextlib.suppress(OSError, ValueError):
            state: dict[str, str] = json.loads((self.folder / STATE).read_text())
            if state.pop("folder", None) == str(self.folder):
                return state
        return {}

    def note(self, parts: dict[str, str]) -> None:
        """Write down what is set up, at once: an interrupt leaves the old note or the new."""
        new = self.folder / f"{STATE}.new"
        new.write_text(json.dumps({"folder": str(self.folder), **parts}))
        new.replace(self.folder / STATE)

    def create(self) -> None:
        """Make it anew, with pip, in place of one that is broken or was made elsewhere."""
        if self.folder.exists() and not (self.folder / "pyvenv.cfg").exists():
            raise Failed(f"{self.folder} is no Python environment: remove it, or name another VENV")
        shutil.rmtree(self.folder, ignore_errors=True)
        made = run([sys.executable, "-m", "venv", str(self.folder)])
        if made.returncode or run([self.python, "-m", "pip", "--version"]).returncode:
            shutil.rmtree(self.folder, ignore_errors=True)
            raise Failed(
                f"{last_lines(made, 8)}\n{sys.executable} cannot make an environment with pip: it "
                "needs the modules venv and ensurepip (on Debian: apt install python3.11-venv)"
            )

    def pip(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run pip without the settings of the user."""
        return run([self.python, "-m", "pip", "--isolated", *arguments])

    def install(self, *arguments: str) -> None:
        """Install what the arguments say; raises Failed with pip's own last words."""
        done = self.pip("install", "--quiet", *self.options, *arguments)
        if done.returncode:
            raise Failed(f"{last_lines(done, 20)}\npip could not install {arguments[-1]}")

    def read_network(self) -> list[str]:
        """Options for pip by the user's settings and variables that say how to reach an index."""
        listed = run([self.python, "-m", "pip", "config", "list"], os.environ).stdout
        found = re.findall(r"^(?:global|install|:env:)\.([a-z-]+)='(.*)'$", listed, re.MULTILINE)
        return [f"--{name}={value}" for name, value in dict(found).items() if name in NETWORK]

    def book(self) -> None:
        """Install what the book needs, and the packages of this checkout in place."""
        pinned = (ROOT / "requirements.txt").read_text(encoding="utf-8")
        torch = re.search(r"^torch==\S+", pinned, re.MULTILINE)
        if torch:
            say("1 of 3: PyTorch, the build without CUDA")
            quick = ("--retries=1", "--timeout=30", "--no-deps", f"--index-url={CPU_TORCH}")
            if self.pip("install", "--quiet", *self.options, *quick, torch[0]).returncode:
                print("    PyTorch's own index does not give it: the ordinary build is larger")
        say("2 of 3: everything else, at the versions and with the digests of requirements.txt")
        self.install("--require-hashes", "-r", str(ROOT / "requirements.txt"))
        say("3 of 3: vtlib and the pages' package, in place")
        packages = ("-e", str(ROOT), "-e", str(ROOT / "book"))
        self.install("--no-deps", "--no-build-isolation", *packages)

    def checks(self) -> None:
        """Install linters, test tools and drivers of browsers."""
        say("what the checks need, with the digests of requirements-checks.txt")
        self.install("--require-hashes", "-r", str(ROOT / "requirements-checks.txt"))

    def kernels(self) -> None:
        """Compile the loops in C++; raises Failed where torch will have to compute instead."""
        say("and the loops in C++, compiled for this machine: a minute or two")
        done = run([self.python, "-m", "vtlab.native"])
        print(last_lines(done, 20))
        if done.returncode:
            raise Failed("")


def run(
    command: list[str], environment: os._Environ[str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a command, by default without what a user's variables would change about it."""
    ours = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("PIP_", "PYTHON")) and name != "__PYVENV_LAUNCHER__"
    }
    ours["PIP_CONFIG_FILE"], ours["PIP_DISABLE_PIP_VERSION_CHECK"] = os.devnull, "1"
    return subprocess.run(
        command, env=environment or ours, capture_output=True, text=True, check=False, cwd=ROOT
    )


def last_lines(done: subprocess.CompletedProcess[str], count: int) -> str:
    """The last lines that a command has written."""
    return "\n".join((done.stdout + done.stderr).strip().splitlines()[-count:])


def say(line: str) -> None:
    """Tell at once what comes next."""
    print(f"--> {line}", flush=True)


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


def set_up(environment: Environment, parts: list[str]) -> None:
    """Do what is missing of some parts, in their order; raises Failed."""
    wanted = {part: digest(PARTS[part]) for part in parts}
    done = environment.done() if works(environment.python, "-m", "pip", "--version") else {}
    missing = [part for part in parts if done.get(part) != wanted[part]]
    if not done:
        print(f"==> Setting up {environment.folder} (once): about 2 minutes, 1.5 GB", flush=True)
        environment.create()
    environment.options = environment.read_network() if missing else []
    for part in missing:
        try:
            getattr(environment, part)()
        except Failed as error:
            if part != "kernels":
                raise
            print(f"{error}    The kernels are not compiled: torch computes instead.", flush=True)
        else:
            done = {**done, part: wanted[part]}
            environment.note(done)


def works(*command: str) -> bool:
    """Whether a command is there and ends well."""
    try:
        return run(list(command)).returncode == 0
    except OSError:
        return False


def main(folder: str, *parts: str) -> int:
    """Command line."""
    if sys.version_info[:2] != (3, 11):
        print(f"Python 3.11 is needed, and {sys.executable} is {sys.version.split()[0]}:")
        print("make PYTHON=/path/to/python3.11 book")
        return 1
    (ROOT / "_build" / "home").mkdir(parents=True, exist_ok=True)  # for what tools write at home
    try:
        with alone(ROOT / "_build" / "set-up.lock", "sets up the environment"):
            set_up(Environment(Path(os.path.abspath(folder))), list(parts))
    except Failed as error:
        print(error)
        return 1
    except KeyboardInterrupt:
        print("Interrupted: the same command goes on.")
        return 130
    return 0


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))
