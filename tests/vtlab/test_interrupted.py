"""Commands that are killed or interrupted, and what the same command then leaves."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

import vtlab

BOOK = Path(vtlab.__file__).parents[1]
# A command that can be killed, for it computes with two processes of its own.
SCRIPT = """
if __name__ == "__main__":
    import os
    import signal
    import sys
    from attrs import evolve
    from vtlab.cli import main
    from vtbook.experiments import EXPERIMENTS
    from vtlab import units
    from vtbook.experiments.cartpole import CARTPOLE

    CARTS = CARTPOLE
    few = evolve(CARTS.pool, name="few", count=10, iterations=200, limit=200)
    some = {label: CARTS.algorithms[label] for label in ("GVT", "DDQN")}
    size = {"pool": few, "runs": 3, "iterations": 300}
    EXPERIMENTS.clear()
    EXPERIMENTS["tiny"] = evolve(CARTS, name="tiny", algorithms=some, **size)
    units.BATCH = 1
    replace = os.replace

    def put_in_place(half, place):
        "A signal comes before a file whose path has that part is put in its place."
        if os.environ.get("KILL_AT", "nothing") in str(place):
            os.kill(os.getpid(), signal.SIGKILL)
        if os.environ.get("INTERRUPT_AT", "nothing") in str(place):
            os.kill(0, signal.SIGINT)  # to all processes, as a terminal does
        replace(half, place)

    os.replace = put_in_place
    sys.exit(main("run tiny --results results --jobs 2".split()))
"""
LIMIT = 10  # seconds from a signal to the end of the last process


class Command:
    """The script, started in a session of its own, as a terminal does."""

    def __init__(self, folder: Path, **more: str) -> None:
        (folder / "script.py").write_text(SCRIPT)
        path = {"PYTHONPATH": os.pathsep.join([str(BOOK.parent), str(BOOK)])}
        self.process = subprocess.Popen(
            [sys.executable, "script.py"],
            cwd=folder,
            env={**os.environ, **path, **more},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            # what a shell starts in the background ignores the interrupt, and so would its children
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )

    def ends_well(self) -> None:
        out, err = self.process.communicate()
        assert self.process.returncode == 0, err
        assert "is complete" in out.splitlines()[-1]
        assert "Traceback" not in err

    def group(self) -> list[int]:
        """Every process of the session that is running."""
        pids = []
        for process in psutil.process_iter():
            with contextlib.suppress(psutil.NoSuchProcess, ProcessLookupError, PermissionError):
                ours = os.getsid(process.pid) == self.process.pid
                if ours and process.status() != psutil.STATUS_ZOMBIE:
                    pids.append(process.pid)
        return pids

    def assert_gone(self, since: float) -> None:
        while self.group() and time.monotonic() < since + LIMIT:
            time.sleep(0.05)
        assert not self.group()


@pytest.fixture(scope="module")
def complete(tmp_path_factory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("complete")
    Command(folder).ends_well()
    return arrays(folder / "results")


def arrays(root: Path) -> dict[str, bytes]:
    """The files of arrays; those beside them tell the time that it took."""
    return {str(p.relative_to(root)): p.read_bytes() for p in root.rglob("*.npz")}


@pytest.mark.parametrize("part", ["few/sources.json", "parts/tiny/GVT"])
def test_killed_or_interrupted_the_same_command_goes_on(tmp_path, complete, part):
    root = tmp_path / "results"
    killed = Command(tmp_path, KILL_AT=part)
    killed.process.communicate()
    assert killed.process.returncode == -signal.SIGKILL
    killed.assert_gone(time.monotonic())
    assert list(root.rglob("*.half"))
    kept = arrays(root)
    interrupted = Command(tmp_path, INTERRUPT_AT=part)
    _, err = interrupted.process.communicate()
    assert interrupted.process.returncode == 130, err
    assert err.splitlines()[-1] == "vtlab: interrupted; run and reproduce go on from here"
    interrupted.assert_gone(time.monotonic())
    assert kept.items() <= arrays(root).items()
    Command(tmp_path).ends_well()
    assert arrays(root) == complete
    assert {p.name for p in root.iterdir()} == {"few", "tiny"}
    assert not list(root.rglob("*.half"))
