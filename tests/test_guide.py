"""The guide's stored runs are what its script computes, and its first lines run from a wheel."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

from vtlib.experiments import store
from vtlib.gym_runs import evaluate

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def runs(extension):
    """The guide's script."""
    return extension("guide_runs")


def test_every_task_has_twenty_runs_of_each_way(runs):
    for name in (f"{kind}-{place}" for kind in runs.KINDS for place in ("within", "outside")):
        found, note = store.read(runs.FOLDER / name)
        assert note["seed"] == runs.SEED
        for way in ("from nothing", "best source", "fine-tuned", "transfer", "improved", "steps"):
            assert found[way].shape == (20,)
            assert np.isfinite(found[way]).all()
        best = found["sources"].mean(1).argmax()
        np.testing.assert_array_equal(found["best source"], found["sources"][best])


def test_the_stored_sources_earn_again_what_is_stored(runs):
    kind = runs.KINDS["windy-grid"]
    weights = torch.from_numpy(store.read(runs.FOLDER / "windy-grid-sources")[0]["weights"])
    envs = [kind.make(kind.within) for _ in range(runs.RUNS)]
    found, _ = store.read(runs.FOLDER / "windy-grid-within")
    earned = evaluate(envs, kind.q, weights[:1].expand(20, 1, -1), seed=runs.SEED).mean(1)
    # rounding on another processor may turn an episode, but not the mean
    assert earned.mean() == pytest.approx(found["sources"][0].mean(), abs=0.1)


def test_what_is_stored_is_not_computed_again(runs, monkeypatch, capsys):
    monkeypatch.setattr(runs, "judge", None)
    monkeypatch.setattr("sys.argv", ["guide_runs.py"])
    runs.main()
    assert capsys.readouterr().out == ""


@pytest.fixture(scope="module")
def run_from_a_wheel(tmp_path_factory):
    """Run Python with arguments in an empty folder, where it finds what the wheel holds."""
    pytest.importorskip("setuptools", "77")  # what pyproject.toml asks for
    source, unpacked, empty = (tmp_path_factory.mktemp(x) for x in ("source", "unpacked", "empty"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for name in ("vtlib", "book/vtbook"):
        without = shutil.ignore_patterns("__pycache__", "lib")  # what is compiled is not packed
        shutil.copytree(ROOT / name, source / name, ignore=without)
    build = "from setuptools.build_meta import build_wheel; print(build_wheel('.'))"
    built = subprocess.run(
        [sys.executable, "-c", build], cwd=source, text=True, capture_output=True, timeout=300
    )
    assert built.returncode == 0, built.stderr
    with zipfile.ZipFile(source / built.stdout.splitlines()[-1]) as wheel:
        wheel.extractall(unpacked)
    kept = {name: x for name, x in os.environ.items() if name != "VTLIB_RESULTS"}

    def run(*arguments):
        return subprocess.run(
            [sys.executable, *arguments],
            cwd=empty,
            env={**kept, "PYTHONPATH": str(unpacked)},
            text=True,
            capture_output=True,
            timeout=300,
        )

    found = run("-c", "import vtlib, vtbook; print(vtlib.__file__, vtbook.__file__)")
    assert found.stdout.count(str(unpacked)) == 2, found
    return run


def test_a_wheel_tells_its_version(run_from_a_wheel):
    (version,) = re.findall(r'^version = "(.*)"', (ROOT / "pyproject.toml").read_text(), re.M)
    assert run_from_a_wheel("-m", "vtlib", "--version").stdout == f"vtlib {version}\n"


def test_a_wheel_without_results_says_in_one_line_where_they_are(run_from_a_wheel):
    told = run_from_a_wheel("-m", "vtlib", "verify")
    assert (told.returncode, told.stdout) == (2, "")
    (line,) = told.stderr.splitlines()
    assert "the book's results are book/results of its repository" in line


def test_the_guides_first_lines_run_from_a_wheel(run_from_a_wheel):
    page = (ROOT / "book" / "guide.md").read_text(encoding="utf-8")
    (cell,) = re.findall(r"```\{code-cell\} python3\n(import gymnasium.*?)```", page, re.DOTALL)
    fewer = cell.replace("iterations=4000", "iterations=200")
    done = run_from_a_wheel("-c", f"{fewer}\nprint(*sources.shape, q.d)")
    assert done.stdout == "4 226 226\n", done
