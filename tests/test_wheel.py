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
README = (ROOT / "README.md").read_text(encoding="utf-8")
# The README's example with short runs, a maze's iteration, and what tells whether kernels compute.
PROGRAM = """
import logging
logging.basicConfig(format="%(message)s")
{example}
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


@pytest.mark.parametrize("compiler", [True, False], ids=["kernels", "no kernels"])
def test_the_example_and_a_maze_run_from_an_empty_folder(unpacked, tmp_path, compiler):
    (example,) = re.findall(r"```python\n(import gymnasium.*?)```", README, re.DOTALL)
    example = re.sub(r"(iterations=|, )(?:4000|1000)\b", r"\g<1>120", example)
    path = [str(unpacked)]
    if not compiler:
        hidden = tmp_path / "hidden"
        hidden.mkdir()
        finder = "import importlib.util as u; f = u.find_spec\n"
        finder += "u.find_spec = lambda n, *a: None if n == 'ziglang' else f(n, *a)\n"
        (hidden / "sitecustomize.py").write_text(finder)
        path.insert(0, str(hidden))
        shutil.rmtree(unpacked / "vtlib" / "native" / "lib", ignore_errors=True)
    empty = tmp_path / "empty"
    empty.mkdir()
    code = PROGRAM.format(example=example)
    done = python(code, empty, PYTHONPATH=os.pathsep.join(path))
    assert done.returncode == 0, done.stderr
    *_, maze, results = done.stdout.splitlines()
    assert maze.startswith("iterations 1 level ")
    assert maze.endswith("None") == (not compiler)
    assert results == str(empty.resolve() / "results")
    lines = [x for x in done.stderr.splitlines() if "torch computes instead" in x]
    assert len(lines) == (not compiler)
    assert all("pip install 'vtlib[native]'" in x for x in lines)
