"""JupyterLab: the panel of a page trains there, too, and the live panel through the kernel."""

import os
import re
import subprocess
import sys

import nbformat
import pytest

pytest.importorskip("jupyterlab")
CELL = """from IPython.display import HTML, display

from vtbook import trainer, widgets
from vtbook.experiments.rooms import ROOMS_EVALUATION
from vtlib.experiments import returns
from vtlib.experiments.store import weights

here = ROOMS_EVALUATION.published
display(HTML(trainer.train_here(here, (2.0, 8.0))))
given = weights(here.pool), {"GVT": returns(here, "GVT")}
display(widgets.LivePanel(here, *given, runs=2, iterations=200).widget)
"""


@pytest.fixture
def lab(tmp_path):
    """The address of a notebook in JupyterLab, whose settings are nobody's."""
    v4 = nbformat.v4
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3"}}
    shown = v4.new_notebook(cells=[v4.new_code_cell(CELL)], metadata=kernel)
    nbformat.write(shown, tmp_path / "panels.ipynb")
    own = {x: str(tmp_path / "own") for x in ("HOME", "JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR")}
    options = "--no-browser", "--allow-root", "--port=0", "--ServerApp.port_retries=0"
    command = [sys.executable, "-m", "jupyterlab", *options, f"--ServerApp.root_dir={tmp_path}"]
    with subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True, env=os.environ | own
    ) as process:
        told = re.compile(r"(http://127\.0\.0\.1:\d+/lab)(\?token=\w+)")
        address, token = next(filter(None, map(told.search, process.stderr))).groups()
        yield f"{address}/tree/panels.ipynb{token}"
        process.terminate()
        process.stderr.read()


def test_both_panels_train_in_jupyterlab(lab, page):
    page.goto(lab)
    page.get_by_text("| Idle").wait_for()
    page.get_by_role("menuitem", name="Run", exact=True).click()
    page.get_by_text("Run All Cells", exact=True).click()
    panel = page.locator(".trainer")
    panel.locator(".says", has_text="Ready").wait_for()
    panel.locator(".door").first.press("ArrowRight")
    panel.get_by_role("button", name="Run", exact=True).click()
    panel.locator(".says", has_text="Done").wait_for()
    told = [panel.locator(f".legend .{x}").inner_text().split()[-1] for x in ("transfer", "none")]
    assert float(told[0]) > float(told[1]) + 0.3
    page.locator(".jupyter-button", has_text="Run").click()
    page.get_by_text("done at 200").wait_for()
    assert not page.foreign
