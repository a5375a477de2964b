"""The notebooks that the pages offer: valid, the same each time, and in need of vtlib alone."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import nbformat
import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted(
    path
    for path in (ROOT / "book").glob("*.md")
    if "\nkernelspec:" in path.read_text(encoding="utf-8")[:500]
)
WITHOUT_THE_BOOK = (
    "import sys; sys.modules.update(dict.fromkeys(('myst_nb', 'sphinx', 'jupytext')))\n"
)


@pytest.fixture
def notebooks(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The extension that makes them."""
    monkeypatch.syspath_prepend(str(ROOT / "book" / "_ext"))
    return importlib.import_module("notebooks")


def code(notebook) -> str:
    """All cells with code, one after another."""
    return "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "code")


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_a_page_becomes_a_valid_notebook(notebooks: ModuleType, page: Path):
    made = notebooks.notebook(page)
    nbformat.validate(made)
    assert nbformat.writes(made) == nbformat.writes(notebooks.notebook(page))
    assert "pip install -e ." in made.cells[0].source
    assert "%%" not in code(made)
    ast.parse(code(made))


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_a_notebook_imports_only_what_vtlib_brings(notebooks: ModuleType, page: Path):
    tree = ast.walk(ast.parse(code(notebooks.notebook(page))))
    names = {node.module for node in tree if isinstance(node, ast.ImportFrom)}
    tree = ast.walk(ast.parse(code(notebooks.notebook(page))))
    names |= {one.name for node in tree if isinstance(node, ast.Import) for one in node.names}
    roots = {name.partition(".")[0] for name in names} - set(sys.stdlib_module_names)
    assert roots <= {"vtlib", "torch", "numpy", "matplotlib", "IPython"}


@pytest.mark.parametrize("name", ["introduction", "setting"])
def test_a_notebook_runs_without_the_book(notebooks: ModuleType, tmp_path: Path, name: str):
    program = WITHOUT_THE_BOOK + code(notebooks.notebook(ROOT / "book" / f"{name}.md"))
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_durations_are_told_in_words(notebooks: ModuleType):
    told = [notebooks.in_words(seconds) for seconds in (0.2, 12.3, 89.0, 200.0)]
    assert told == ["about a second", "12 seconds", "89 seconds", "3 minutes"]
