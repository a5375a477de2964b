"""A real JupyterLab: every page reads there, and pages run and train."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("jupyterlab")
BOOK = Path(__file__).resolve().parents[1] / "book"
# The build has run the cells of all pages, in an empty folder as here. Here those run with which a
# reader begins: the book, an experiment, and transfer between tasks of one's own.
RUN = "index", "rooms_evaluation", "guide"
COPY = """import lab, pathlib, sys
lab.write_settings()
lab.copy_pages(*map(pathlib.Path, sys.argv[1:]))"""
# Cells out of sight would not be drawn, and so not be looked at.
WHOLE = {"@jupyterlab/notebook-extension:tracker": {"windowingMode": "none"}}
OPEN = "document.querySelectorAll('.jp-Notebook .jp-Cell').length > 1"
# Opens a page without a kernel: what of its text is not drawn, or is a formula and a wrong one.
READ = """async path => {
  const kernelPreference = { canStart: false, shouldStart: false, autoStartDefault: false };
  const { commands } = window.jupyterapp;
  const page = await commands.execute("docmanager:open", { path, kernelPreference });
  await page.context.ready;
  const all = what => [...page.node.querySelectorAll(what)];
  const text = ".jp-RenderedMarkdown", count = page.content.model.cells.length;
  const left = () => [
    ...all(`${text}:empty`),
    ...all(`${text} :is(p, li, td, h1, h2)`)
      .filter(one => !one.querySelector("code") && one.innerText.includes("$")),
  ];
  for (let i = 0; i < 1000 && (all(".jp-Cell").length < count || left().length); i++)
    await new Promise(done => setTimeout(done, 50));
  const wrong = [...left(), ...all("mjx-merror, [data-mjx-error]")].map(one => one.outerHTML);
  const missing = count - all(".jp-Cell").length;
  page.dispose();
  return [missing, ...wrong];
}"""
# Of sliders over stored pictures those that look as if they missed a kernel, and holes.
FLAWS = """() => {
  const all = what => [...document.querySelectorAll(what)];
  const off = ".still.jupyter-widgets-disconnected, .still .jupyter-widgets-disconnected";
  const signed = all(off).filter(one => getComputedStyle(one, "::before").display !== "none");
  const holes = all("svg.frame").filter(one => one.getBoundingClientRect().height > 1);
  return [signed.length, holes.length, all("svg.frame").length > 0];
}"""
# What a cell has printed, an error's name, and every warning on the way.
RUN_ALL = """async () => {
  const app = window.jupyterapp, { content, context } = app.shell.currentWidget;
  await context.sessionContext.ready;
  await app.commands.execute("notebook:run-all-cells");
  const cells = content.model.sharedModel.toJSON().cells.filter(x => x.cell_type === "code");
  const outputs = cells.flatMap(x => x.outputs);
  await context.save();
  return {
    counts: cells.map(x => x.execution_count),
    errors: outputs.filter(x => x.output_type === "error").map(x => `${x.ename}: ${x.evalue}`),
    warnings: outputs.filter(x => x.name === "stderr").map(x => [x.text].flat().join(""))
      .filter(x => x.includes("Warning")),
  };
}"""


@pytest.fixture(scope="module")
def lab(book, tmp_path_factory):
    """JupyterLab's address by page, over copies of the built notebooks, with nobody's settings."""
    home = tmp_path_factory.mktemp("lab")
    # as a reader starts it: threads are the library's own business
    own = {x: y for x, y in os.environ.items() if x != "OMP_NUM_THREADS"}
    own |= {f"JUPYTER_{x}_DIR": str(home / x.lower()) for x in ("CONFIG", "DATA")}
    own["HOME"] = str(home)
    folders = [str(book / "_sources" / "notebooks"), str(home / "notebooks")]
    ext = {"PYTHONPATH": str(BOOK / "_ext")}
    subprocess.run([sys.executable, "-c", COPY, *folders], env=own | ext, check=True)
    settings = home / "config" / "labconfig" / "default_setting_overrides.json"
    settings.write_text(json.dumps(json.loads(settings.read_text()) | WHOLE))
    options = "--no-browser", "--allow-root", "--port=0", "--ServerApp.port_retries=0"
    tested = "--LabApp.expose_app_in_browser=True", f"--ServerApp.root_dir={home / 'notebooks'}"
    command = [sys.executable, "-m", "jupyterlab", *options, *tested]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=own) as process:
        pattern = re.compile(r"(http://127\.0\.0\.1:\d+)/lab\S*(\?token=\w+)")
        address, token = next(filter(None, map(pattern.search, process.stderr))).groups()
        # each test has tabs of its own
        yield lambda path: f"{address}/lab/tree/{path}{token}&reset"
        process.terminate()
        process.stderr.read()


@pytest.fixture(scope="module")
def files(book):
    """The file of each page, in the book's order."""
    paths = sorted((book / "_sources" / "notebooks").glob("*.ipynb"))
    return {path.stem.partition("-")[2]: path.name for path in paths}


def test_lab_opens_on_the_first_page_lists_the_book_in_its_order_and_each_page_reads(
    lab, files, page
):
    page.goto(lab("00-index.ipynb"))
    page.wait_for_function(OPEN)
    page.get_by_role("heading", name="Variational Transfer of Value Functions").wait_for()
    names = page.locator(".jp-DirListing-itemText").all_inner_texts()
    order = [x.partition("-")[2].partition(".")[0] for x in names]
    toc = re.findall(r"(?:root|file): book/(\w+)", (BOOK.parent / "_toc.yml").read_text())
    shown = [x for x in toc if not x.startswith(("api", "references"))]
    assert sorted(order[:-1], key=shown.index) == order[:-1]
    assert set(order) == set(shown)
    for name, file in files.items():
        assert page.evaluate(READ, file) == [0], name
    assert not page.foreign


@pytest.mark.parametrize("name", RUN)
def test_a_page_runs_from_top_to_bottom(lab, files, page, name):
    page.goto(lab(files[name]))
    page.wait_for_function(OPEN)
    page.get_by_text("| Idle").wait_for()
    if name == "rooms_evaluation":  # as it opens, before a cell is run
        page.locator("svg.frame").first.wait_for(state="attached")
        assert page.evaluate(FLAWS) == [0, 0, True]
    done = page.evaluate(RUN_ALL)
    assert (done["errors"], done["warnings"]) == ([], [])
    assert done["counts"] == [*range(1, len(done["counts"]) + 1)]
    assert page.locator("mjx-merror, [data-mjx-error]").count() == 0
    assert not page.foreign
    if name == "rooms_evaluation":
        train_live(page)
        train_in_the_page(page)
    page.evaluate("window.jupyterapp.serviceManager.sessions.shutdownAll()")


ANOTHER = "([panel, old]) => { const img = panel.querySelector('img'); return img.src !== old; }"


def train_live(page):
    """Train in the live panel with lambda, psi and the posterior moved: curves differ."""
    panel = page.locator(".jp-OutputArea-output", has=page.locator(".jupyter-button")).last
    panel.scroll_into_view_if_needed()
    power, psi, posterior = panel.locator(".noUi-handle").all()[:3]
    for name, value in {"runs": "2", "iterations": "1000"}.items():
        box = panel.locator(".widget-text", has_text=name).locator("input")
        box.fill(value)
        box.press("Enter")
    for handle, key in ((posterior, "End"), (psi, "Home"), (power, "End")):
        old = panel.locator("img").get_attribute("src")
        handle.press(key)
        panel.get_by_role("button", name="Run").click()
        page.wait_for_function(ANOTHER, arg=[panel.element_handle(), old])
        panel.get_by_text("done at 1,000").wait_for()
        assert "3-MGVT, just now" in panel.locator("img").get_attribute("alt")


def train_in_the_page(page):
    """The panel that trains in the browser does so in a notebook, too."""
    panel = page.locator(".trainer")
    panel.locator(".says", has_text="Ready").wait_for()
    panel.locator(".door").first.press("ArrowRight")
    panel.get_by_role("button", name="Run", exact=True).click()
    panel.locator(".says", has_text="Done").wait_for()
    earned = [panel.locator(f".legend .{x}").inner_text().split()[-1] for x in ("transfer", "none")]
    assert float(earned[0]) > float(earned[1]) + 0.3
