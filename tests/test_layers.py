"""The three packages import in one direction, and the method alone is light."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
HEAVY = "xarray scipy matplotlib ipywidgets PIL"
LINT = [sys.executable, "-c", "from importlinter.cli import lint_imports_command as lint; lint()"]


@pytest.mark.parametrize(
    ("file", "line", "broken"),
    [
        ("vtlib/td.py", "from vtlib.checks import shown", None),
        ("vtlib/td.py", "from vtlib.transfer import Settings", "A file of the method"),
        ("vtlib/posteriors/dense.py", "import scipy.linalg", "The method needs nothing"),
        ("vtlib/episodes.py", "import vtlab.envs.base", "The pages import"),
        ("vtlib/new.py", "", "A file of the method"),
    ],
)
def test_an_import_that_leads_upward_is_found(tmp_path, file, line, broken):
    pytest.importorskip("importlinter")  # among a checkout's tools
    for name in ("vtlib", "book/vtlab", "book/vtbook"):
        without = shutil.ignore_patterns("__pycache__", "lib")
        shutil.copytree(ROOT / name, tmp_path / name, ignore=without)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    with (tmp_path / file).open("a", encoding="utf-8") as copy:
        copy.write(f"{line}\n")
    done = subprocess.run(
        [*LINT, "--no-cache"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{tmp_path / 'book'}"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    contracts = re.findall(r"^(.*) BROKEN$", done.stdout, re.MULTILINE)
    assert [x for x in contracts if not (broken and x.startswith(broken))] == [], done
    assert (len(contracts), done.returncode) == ((1, 1) if broken else (0, 0)), done


def test_the_method_loads_nothing_that_only_experiments_and_pages_need():
    code = f"""
import importlib, pkgutil, sys
import vtlib
for module in pkgutil.walk_packages(vtlib.__path__, "vtlib."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
print(*{{x.split(".")[0] for x in sys.modules}} & {{*{f"{HEAVY} vtlab vtbook".split()}}})
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "\n"
