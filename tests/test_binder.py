"""Binder's image: what sets it up does so from nothing, and JupyterLab opens there on a page."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


# Skipped in `make test`, which would set up a second environment for minutes and needs no image.
# The workflow sets the variable, and runs this test for each push to main and each pull request.
@pytest.mark.skipif(
    "VTLIB_BINDER" not in os.environ,
    reason="installs everything anew, which takes minutes: the workflow sets VTLIB_BINDER=1",
)
def test_an_image_is_set_up_from_nothing(book, tmp_path):
    checkout, venv = tmp_path / "checkout", tmp_path / "venv"
    subprocess.run(["git", "clone", "-q", ROOT, checkout], check=True)
    subprocess.run([sys.executable, "-m", "venv", venv], check=True)
    # pages that have run need not run again: the cache knows them by what they depend on
    shutil.copytree(ROOT / "_build" / ".jupyter_cache", checkout / "_build" / ".jupyter_cache")
    foreign = ("VIRTUAL_ENV", "PYTHON", "JUPYTER", "VTLIB", "OMP_")
    kept = {x: y for x, y in os.environ.items() if not x.startswith(foreign)}
    own = {"HOME": str(tmp_path), "PATH": f"{venv}/bin:{os.environ['PATH']}"}
    done = subprocess.run(
        ["bash", "binder/postBuild"], cwd=checkout, env=kept | own, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    notebooks = sorted(x.name for x in (checkout / "notebooks").iterdir())
    assert "00-index.ipynb" in notebooks
    code = "import vtlib, vtbook; print(vtlib.__file__)"
    elsewhere = {"cwd": tmp_path, "capture_output": True, "text": True}
    where = subprocess.run(["python", "-c", code], env=kept | own, **elsewhere)
    assert where.stdout.startswith(str(checkout))
