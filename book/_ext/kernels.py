"""Kernels of pages, forked from one process that has imported what pages import.

That takes longer than running many a page does, and all of them import the same.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import pkgutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

BESIDES = ("ipykernel.kernelapp", "matplotlib.backends.backend_agg", "myst_nb", "scipy.stats")
WATCH = 2.0  # seconds between looks at whether the build is still there


@contextlib.contextmanager
def forked() -> Iterator[type]:
    """A class of managers, for as long as it is needed, whose kernels are forked."""
    from jupyter_client import AsyncKernelManager

    # a socket's path may have some 100 characters, which a folder elsewhere could exceed
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:
        address = str(Path(folder) / "kernels")

        class Forked(AsyncKernelManager):
            def format_kernel_cmd(self, extra_arguments: list[str] | None = None) -> list[str]:
                wanted = ["-f", self.connection_file, *(extra_arguments or [])]
                return [sys.executable, __file__, address, *wanted]

        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(address)
            listening.listen()
            number = listening.fileno()
            command = [sys.executable, __file__, str(number)]
            with subprocess.Popen(command, pass_fds=[number]) as origin:
                listening.close()  # or who asks would wait for one that has failed
                try:
                    yield Forked
                finally:
                    origin.kill()


def serve(listening: socket.socket) -> None:
    """Import what pages import, then become a kernel whenever one is asked for."""
    import vtbook

    parts = pkgutil.walk_packages(vtbook.__path__, "vtbook.")
    for name in [*BESIDES, *(part.name for part in parts)]:
        importlib.import_module(name)
    build = os.getppid()
    listening.settimeout(WATCH)
    while os.getppid() == build:
        with contextlib.suppress(ChildProcessError):
            os.waitpid(-1, os.WNOHANG)
        try:
            asked, _ = listening.accept()
        except TimeoutError:
            continue
        if os.fork() == 0:
            listening.close()
            become_kernel(asked)
        asked.close()


def become_kernel(asked: socket.socket) -> None:
    """Run a kernel where and how the one who asks says, and no longer than that one lives."""
    from ipykernel.kernelapp import IPKernelApp

    asked.settimeout(None)
    given: dict[str, Any] = json.loads(asked.makefile().readline())
    # who does not answer has ended
    threading.Thread(target=lambda: (asked.recv(1), os._exit(1)), daemon=True).start()
    os.chdir(given["folder"])
    os.environ.clear()
    os.environ.update(given["environment"])
    parent = f"--IPKernelApp.parent_handle={os.getppid()}"
    IPKernelApp.launch_instance(argv=[*given["arguments"], parent])
    os._exit(0)


def ask(address: str, arguments: list[str]) -> None:
    """Stand for the kernel that is asked for: end when it does, and not when it is interrupted."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    given = {"arguments": arguments, "folder": os.getcwd(), "environment": dict(os.environ)}
    with socket.socket(socket.AF_UNIX) as asking:
        asking.connect(address)
        asking.sendall(json.dumps(given).encode() + b"\n")
        asking.recv(1)


if __name__ == "__main__":
    first, *others = sys.argv[1:]
    if first.isdecimal():
        serve(socket.socket(fileno=int(first)))
    else:
        ask(first, others)
