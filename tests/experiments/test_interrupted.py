"""Commands that are killed or interrupted at any moment, and what the same command then leaves."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from attrs import evolve

from vtbook.experiments.cartpole import CARTPOLE
from vtlib.experiments import schedule, store
from vtlib.experiments.run import run_batch

# A command of its own, which can be killed: one that computes with two processes of its own, for
# whom nothing here is meant.
SCRIPT = """
if __name__ == "__main__":
    from vtlib.interrupts import end_at_once

    end_at_once()
    import os
    import signal
    import sys
    from attrs import evolve
    from vtlib.cli import main
    from vtbook.experiments import EXPERIMENTS
    from vtlib.experiments import schedule
    from vtbook.experiments.cartpole import CARTPOLE

    CARTS = CARTPOLE.published
    few = evolve(CARTS.pool, name="few", count=10, iterations=200, limit=200)
    some = {label: CARTS.algorithms[label] for label in ("GVT", "DDQN")}
    size = {"pool": few, "runs": 3, "iterations": int(sys.argv[2])}
    EXPERIMENTS.clear()
    EXPERIMENTS["tiny"] = evolve(CARTS, name="tiny", algorithms=some, **size)
    schedule.BATCH = 1
    count, replace = 0, os.replace

    def put_in_place(*names):
        "The command is killed before the file of that number is put in its place."
        global count
        count += 1
        if count == int(os.environ.get("KILL_AT", 0)):
            os.kill(os.getpid(), signal.SIGKILL)
        replace(*names)

    os.replace = put_in_place
    command, *rest = sys.argv[3:] or ["run", "tiny", "--jobs", "2"]
    sys.exit(main([command, *rest, "--results", sys.argv[1]]))
"""


class Command:
    """The script, started in a session of its own, as a terminal does."""

    def __init__(self, folder: Path, iterations: int, *arguments: str, **more: str) -> None:
        (folder / "script.py").write_text(SCRIPT)
        path = {"PYTHONPATH": str(Path(schedule.__file__).parents[2])}
        self.process = subprocess.Popen(
            [sys.executable, "script.py", str(folder / "results"), str(iterations), *arguments],
            cwd=folder,
            env={**os.environ, **path, **more},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def ends_well(self, said: str) -> None:
        out, err = self.process.communicate()
        assert self.process.returncode == 0, err
        assert said in out.splitlines()[-1]
        assert "Traceback" not in err

    def is_killed(self) -> None:
        self.process.communicate()
        assert self.process.returncode == -signal.SIGKILL
        self.assert_gone()

    def group(self) -> list[int]:
        """Every process of the session that is running."""
        found = []
        for one in psutil.process_iter():
            with contextlib.suppress(psutil.NoSuchProcess, ProcessLookupError, PermissionError):
                if os.getsid(one.pid) == self.process.pid and one.status() != psutil.STATUS_ZOMBIE:
                    found.append(one.pid)
        return found

    def assert_gone(self) -> None:
        end = time.monotonic() + 30
        while self.group() and time.monotonic() < end:
            time.sleep(0.05)
        assert not self.group()


def test_killed_while_a_file_is_put_in_place_the_same_command_goes_on(tmp_path):
    root, iterations = tmp_path / "results", 400
    # of the pool, of the targets, of a batch of runs, and of a result joined from batches
    for number in (1, 2, 3, 4, 6, 5):
        Command(tmp_path, iterations, KILL_AT=str(number)).is_killed()
        assert list(root.rglob("*.half"))
    Command(tmp_path, iterations).ends_well(f"tiny is complete under {root}")
    # what undisturbed runs would have left, and nothing beside
    carts = CARTPOLE.published
    few = evolve(carts.pool, name="few", count=10, iterations=200, limit=200)
    undisturbed = evolve(carts, name="tiny", pool=few, runs=3, iterations=iterations)
    weights = store.weights(few, root)
    for label in ("GVT", "DDQN"):
        each = [run_batch(undisturbed, label, [one], weights) for one in range(3)]
        found, _ = store.read(root / "tiny" / label)
        for key in found.keys() - {"iterations"}:
            np.testing.assert_array_equal(found[key], np.concatenate([one[key] for one in each]))
    assert {p.name for p in root.iterdir()} == {"few", "tiny"}
    assert not list(root.rglob("*.half"))
    left = {p.name for p in tmp_path.iterdir()} - {"__pycache__"}
    assert left == {"script.py", "results"}


ITERATIONS = 1_000  # a second of computing
MOMENTS = int(os.environ.get("VTLIB_MOMENTS", "2"))  # more on demand
COMMANDS = {
    "run": ("run", "tiny", "--jobs", "2"),
    "reproduce": ("reproduce", "--only", "tiny", "--jobs", "2", "--fresh", "fresh"),
    "verify": ("verify", "tiny", "--whole", "--record"),
}
DONE = {"run": "is complete", "reproduce": "none differs", "verify": "verified whole"}


@pytest.fixture(scope="module")
def complete(tmp_path_factory) -> Path:
    """What the command stores undisturbed, for those that check it."""
    folder = tmp_path_factory.mktemp("complete")
    Command(folder, ITERATIONS).ends_well(DONE["run"])
    return folder / "results"


@pytest.mark.parametrize(("command", "moments"), [("reproduce", (1, 5)), ("verify", (1,))])
def test_killed_while_it_checks_the_same_command_comes_to_the_same_end(
    tmp_path, complete, command, moments
):
    shutil.copytree(complete, tmp_path / "results")
    before = {path: path.read_bytes() for path in (tmp_path / "results").rglob("*.*")}
    for number in moments:
        Command(tmp_path, ITERATIONS, *COMMANDS[command], KILL_AT=str(number)).is_killed()
    Command(tmp_path, ITERATIONS, *COMMANDS[command]).ends_well(DONE[command])
    # what is checked is never touched
    assert {path: path.read_bytes() for path in before} == before
    assert not list(tmp_path.rglob("*.half"))


@pytest.mark.parametrize(
    ("command", "number"),
    [*((command, signal.SIGINT) for command in COMMANDS), ("run", signal.SIGTERM)],
)
def test_an_interrupt_at_any_moment_ends_in_one_line_and_with_all_processes(
    tmp_path, complete, command, number
):
    # while it imports, starts workers, computes and stores; a second or two to each
    moments = np.random.default_rng([number, *command.encode()]).uniform(0.6, 8, MOMENTS)
    if command != "run":  # something has to be stored
        shutil.copytree(complete, tmp_path / "results")
    for wait in moments:
        it = Command(tmp_path, ITERATIONS, *COMMANDS[command])
        time.sleep(wait)
        if it.process.poll() is not None:
            it.ends_well(DONE[command])
            continue
        os.killpg(it.process.pid, number)
        out, err = it.process.communicate(timeout=10)
        it.assert_gone()
        if not it.process.returncode:  # it was about to leave
            assert DONE[command] in out.splitlines()[-1]
            continue
        assert it.process.returncode == 128 + number, err
        *bar, line = err.strip().splitlines()
        assert line == "vtlib: interrupted; the same command goes on from here"
        assert all("left" in shown for shown in bar if shown), err
        assert not list(Path(tempfile.gettempdir()).glob(f"vtlib-{it.process.pid}-*"))
    Command(tmp_path, ITERATIONS, *COMMANDS[command]).ends_well(DONE[command])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_once_its_work_is_done_an_interrupt_changes_nothing(number):
    program = f"""
import os
from vtlib.interrupts import end_at_once

class Last:
    def __del__(self, kill=os.kill, pid=os.getpid()):
        kill(pid, {number:d})  # while Python tidies up

end_at_once()
last = Last()
"""
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
