"""The wheel: the method and the laboratory, with kernels where they are compiled and without."""

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from vtlib.native.build import CACHE

pytest.importorskip("setuptools", "77")  # what pyproject.toml asks for
ROOT = Path(__file__).resolve().parents[1]
# A maze's iteration, and what tells whether kernels compute.
PROGRAM = """
import logging
logging.basicConfig(format="%(message)s")
import torch, vtlab.envs.maze, vtlab.store
from vtlib import Settings, native
from vtlab.episodes import Episodes
from vtlib.rng import Rng
from vtlib.training import iterate
family = vtlab.envs.maze.MazeFamily()
rng, tasks = Rng("wheel", [0]), family.draw_tasks("wheel", [0])
episodes = Episodes(tasks, rng.stream("noise"), rng.stream("start"))
sources = 0.1 * torch.ones(1, 2, family.q().d)
agent = Settings(minibatch=5, n_samples=2).agent(family.q(), sources, tasks.obs_dim, rng)
print("iterations", next(iterate(agent, episodes)), "level", native.level())
print(vtlab.store.results_folder().resolve())
"""


def python(code, folder, **environment):
    """Run a program in a folder, in a Python that sees the unpacked wheel and what is installed."""
    kept = {x: y for x, y in os.environ.items() if not x.startswith("VTLIB")}
    # What the checkout has compiled of the compiler's own libraries need not be compiled again.
    kept |= dict.fromkeys(("ZIG_LOCAL_CACHE_DIR", "ZIG_GLOBAL_CACHE_DIR"), str(CACHE))
    command, out = [sys.executable, "-P", "-c", code], {"capture_output": True, "text": True}
    return subprocess.run(command, cwd=folder, env=kept | environment, **out)


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    """Where the wheel of these sources is unpacked, as an installation would do it."""
    folder = tmp_path_factory.mktemp("wheel")
    source, site = folder / "source", folder / "site"
    without = shutil.ignore_patterns("__pycache__", "lib")
    for name in ("vtlib", "book/vtlab", "book/vtbook"):
        shutil.copytree(ROOT / name, source / name, ignore=without)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    built = python("from setuptools.build_meta import build_wheel; print(build_wheel('.'))", source)
    assert built.returncode == 0, built.stderr
    with zipfile.ZipFile(source / built.stdout.splitlines()[-1]) as wheel:
        wheel.extractall(site)
    return site


def test_it_holds_the_method_and_the_laboratory_and_no_pages(unpacked):
    assert {x.name for x in unpacked.iterdir() if x.suffix != ".dist-info"} == {"vtlib", "vtlab"}
    for name in ("vtlab/envs/maze/mazes.txt", "vtlib/py.typed", "vtlib/native/posterior.cpp"):
        assert (unpacked / name).exists()
    (metadata,) = unpacked.glob("*.dist-info/METADATA")
    needed = re.findall(r"^Requires-Dist: ([a-z]+)[^;\n]*$", metadata.read_text(), re.MULTILINE)
    assert sorted(needed) == ["attrs", "gymnasium", "numpy", "torch", "tqdm"]


@pytest.mark.parametrize("hidden", ["", "import sys; sys.modules['ziglang'] = None"])
def test_a_maze_runs_from_an_empty_folder_with_kernels_and_without(unpacked, tmp_path, hidden):
    shutil.rmtree(unpacked / "vtlib" / "native" / "lib", ignore_errors=True)
    done = python(hidden + PROGRAM, tmp_path, PYTHONPATH=str(unpacked))
    assert done.returncode == 0, done.stderr
    maze, results = done.stdout.splitlines()
    assert maze.startswith("iterations 1 level ")
    assert maze.endswith("None") == bool(hidden)
    assert results == str(tmp_path.resolve() / "results")
    lines = [x for x in done.stderr.splitlines() if "torch computes instead" in x]
    assert len(lines) == bool(hidden)
    assert all("pip install 'vtlib[native]'" in x for x in lines)
