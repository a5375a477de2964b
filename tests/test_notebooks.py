"""The notebooks that the pages offer: valid, the same each time, and in need of vtlib alone."""

import ast
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

BOOK = Path(__file__).resolve().parents[1] / "book"
PAGES = sorted(
    path for path in BOOK.glob("*.md") if "\nkernelspec:" in path.read_text(encoding="utf-8")[:500]
)
WITHOUT_THE_BOOK = "import sys; sys.modules.update(dict.fromkeys(('myst_nb', 'jupytext')))\n"
BROUGHT = "vtlib vtbook torch numpy gymnasium scipy xarray attrs matplotlib IPython"  # by vtlib


def code(notebook) -> str:
    """All cells with code, one after another."""
    return "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "code")


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_a_page_becomes_a_valid_notebook_that_needs_vtlib_alone(extension, page):
    made, again = (extension("notebooks").notebook(page) for _ in range(2))
    nbformat.validate(made)
    assert nbformat.writes(made) == nbformat.writes(again)
    assert "pip install -e ." in made.cells[0].source
    assert "%%" not in code(made)
    for node in ast.walk(ast.parse(code(made))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            name = getattr(node, "module", node.names[0].name)
            assert name.partition(".")[0] in {*BROUGHT.split(), *sys.stdlib_module_names}


def test_a_notebook_runs_without_the_book(extension, tmp_path):
    program = WITHOUT_THE_BOOK + code(extension("notebooks").notebook(BOOK / "introduction.md"))
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
