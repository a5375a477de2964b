"""What others can put in without touching the library: an experiment of their own."""

import importlib
import os
import subprocess
import sys
from pathlib import Path

import vtlib
from vtlab.store import load, returns
from vtlab.verify import verify
from vtlib.posteriors import COVARIANCES

ROOT = Path(vtlib.__file__).parents[1]

CORRIDORS = Path(__file__).with_name("corridors.py").read_text(encoding="utf-8")


def test_an_experiment_with_a_posterior_of_ones_own_is_run_by_its_name(tmp_path, monkeypatch):
    (tmp_path / "corridors.py").write_text(CORRIDORS)
    offered = tmp_path / "corridors-1.0.dist-info"
    offered.mkdir()
    (offered / "METADATA").write_text("Metadata-Version: 2.1\nName: corridors\nVersion: 1.0\n")
    (offered / "entry_points.txt").write_text("[vtlab.experiments]\nours = corridors:EXPERIMENTS\n")
    before, root = {*tmp_path.iterdir()}, tmp_path / "results"
    path = os.pathsep.join([str(ROOT), str(ROOT / "book"), str(tmp_path)])
    command = "-W error -m vtlab run ours --jobs 1 --results results"
    done = subprocess.run(
        [sys.executable, *command.split()],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert (done.returncode, done.stdout) == (0, "ours is complete under results\n"), done.stderr
    assert {*tmp_path.iterdir()} == {*before, root}
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(COVARIANCES, "isotropic", None)
    mine = importlib.import_module("corridors").EXPERIMENTS["mine"]
    result = returns(mine, "GVT", root)
    assert result.attrs["config"]["algorithm"]["covariance"] == "isotropic"
    assert result.learning.dims == ("run", "iteration")
    assert (result.learning[:, -1] > 0.8 * result.optimum).all()
    assert load(mine.pool, "sources", root).goal.dims == ("source",)
    for owner, label, verdict in verify(mine, root=root):
        assert verdict.said in ("2 of 2 equal", "3 of 3 equal"), f"{owner.name}/{label}"
