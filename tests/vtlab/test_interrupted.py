"""Commands that are killed or interrupted at any moment, and what the same command then leaves."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from itertools import cycle
from pathlib import Path

import numpy as np
import psutil
import pytest

import vtlab
from vtlab.interrupts import LINE

BOOK = Path(vtlab.__file__).parents[1]
# A command that can be killed, for it computes with two processes of its own.
SCRIPT = """
if __name__ == "__main__":
    from vtlab.interrupts import end_at_once

    end_at_once()
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
        "The command is killed before a file whose path has that part is put in its place."
        if os.environ.get("KILL_AT", "nothing") in str(place):
            os.kill(os.getpid(), signal.SIGKILL)
        replace(half, place)

    os.replace = put_in_place
    sys.exit(main("run tiny --results results --jobs 2".split()))
"""
MOMENTS = int(os.environ.get("VTLIB_MOMENTS", "2"))  # more on demand
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


def test_killed_or_interrupted_at_any_moment_the_same_command_goes_on(tmp_path, complete):
    root = tmp_path / "results"
    for part in ["few/sources.json", "parts/tiny/GVT"]:
        killed = Command(tmp_path, KILL_AT=part)
        killed.process.communicate()
        assert killed.process.returncode == -signal.SIGKILL
        killed.assert_gone(time.monotonic())
        assert list(root.rglob("*.half"))
    # once Python has started; and while it imports, starts workers, computes and stores
    rng = np.random.default_rng(0)
    moments = [rng.uniform(0.15, 0.4), *rng.uniform(0.6, 8, MOMENTS)]
    for wait, number in zip(moments, cycle([signal.SIGINT, signal.SIGTERM])):
        command = Command(tmp_path)
        time.sleep(wait)
        if command.process.poll() is not None:
            command.ends_well()
            continue
        since = time.monotonic()
        os.killpg(command.process.pid, number)
        _, err = command.process.communicate(timeout=LIMIT)
        command.assert_gone(since)
        if command.process.returncode:  # else it was about to leave
            assert command.process.returncode == 128 + number, err
            *bar, line = err.strip().splitlines()
            assert line == "vtlab: interrupted; run and reproduce go on from here"
            assert all("left" in text for text in bar if text), err
    Command(tmp_path).ends_well()
    assert arrays(root) == complete
    assert {p.name for p in root.iterdir()} == {"few", "tiny"}
    assert not list(root.rglob("*.half"))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_during_the_first_import_of_anything_slow_ends_in_one_line(number):
    program = f"""
import os, runpy, sys

class Signalling:
    def find_spec(self, name, *_):
        if name in {{"attrs", "multiprocessing", "numpy", "torch"}}:
            os.kill(os.getpid(), {number:d})

sys.meta_path.insert(0, Signalling())
runpy.run_module("vtlab", run_name="__main__")
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (128 + number, LINE)
