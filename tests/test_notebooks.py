"""The notebooks of the built book: they read as the pages do, and run wherever vtlib is."""

import ast
import re
import sys
from pathlib import Path

import nbformat
import pytest

BOOK = Path(__file__).resolve().parents[1] / "book"
REFERENCE = {"api", "references"}
PAGES = sorted({path.stem for path in BOOK.glob("*.md")} - REFERENCE)
# The packages that come with an installation from a checkout.
BROUGHT = "vtlib vtlab vtbook torch numpy gymnasium scipy xarray attrs matplotlib IPython"
MYST = re.compile(r"\{[a-z]+(?::\w+)?\}`|^[`:]{3,}\{|^\([\w-]+\)=$|\$\$ \(", re.MULTILINE)
MACRO = re.compile(r"\\(?:E|KL|mm|R)(?![A-Za-z])")


@pytest.mark.parametrize("page", PAGES)
def test_a_page_is_a_valid_notebook_without_holes_that_needs_vtlib_alone(book, page):
    (path,) = (book / "_sources" / "notebooks").glob(f"*-{page}.ipynb")
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    code = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "code")
    assert ("pip install -e . -e book" in notebook.cells[0].source) == bool(code)
    assert "%%" not in code
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            name = getattr(node, "module", node.names[0].name)
            # where the book's kernels have parts of these already, a notebook has to import them
            assert isinstance(node, ast.ImportFrom) or name not in ("scipy", "vtbook", "vtlab")
            assert name.partition(".")[0] in {*BROUGHT.split(), *sys.stdlib_module_names}
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            prose = re.sub(r"^```.*?^```", "", cell.source, flags=re.DOTALL | re.MULTILINE)
            assert MYST.findall(prose) == []
            assert MACRO.findall(prose) == []
            for name in re.findall(r"\]\(([^)]*\.ipynb)\)", prose):
                assert (path.parent / name).exists(), name


def test_pages_are_copied_again_when_the_book_changes_but_what_a_reader_changed_stays(
    extension, tmp_path, monkeypatch
):
    monkeypatch.setenv("JUPYTER_DATA_DIR", str(tmp_path / "data"))
    built, copy, v4 = (
        tmp_path / "00-index.ipynb",
        tmp_path / "copies" / "00-index.ipynb",
        nbformat.v4,
    )

    def copied(source):
        nbformat.write(v4.new_notebook(cells=[v4.new_code_cell(source)]), built)
        return extension("lab").copy_pages(tmp_path, copy.parent)

    assert copied("1 + 1") == []
    run = nbformat.read(copy, 4)
    run.cells[0].execution_count = 5
    nbformat.write(run, copy)
    assert copied("1 + 1") == []
    assert nbformat.read(copy, 4).cells[0].execution_count == 5
    assert copied("2 + 2") == []
    assert nbformat.read(copy, 4).cells[0].source == "2 + 2"
    run.cells[0].source = "mine"
    nbformat.write(run, copy)
    for source in ("2 + 2", "3 + 3"):
        assert copied(source) == ["00-index.ipynb"]
        assert nbformat.read(copy, 4).cells[0].source == "mine"
    copy.unlink()
    assert copied("3 + 3") == []
    assert nbformat.read(copy, 4).cells[0].source == "3 + 3"


@pytest.mark.parametrize("edited", [False, True])
def test_the_copy_of_a_page_that_has_moved_goes_unless_a_reader_changed_it(
    extension, tmp_path, monkeypatch, edited
):
    monkeypatch.setenv("JUPYTER_DATA_DIR", str(tmp_path / "data"))
    v4, copies, built = nbformat.v4, tmp_path / "copies", tmp_path / "01-idea.ipynb"
    nbformat.write(v4.new_notebook(cells=[v4.new_code_cell("1 + 1")]), built)
    extension("lab").copy_pages(tmp_path, copies)
    if edited:
        nbformat.write(v4.new_notebook(cells=[v4.new_code_cell("mine")]), copies / built.name)
    built.rename(tmp_path / "02-idea.ipynb")
    for _ in range(2):
        extension("lab").copy_pages(tmp_path, copies)
        assert (copies / "02-idea.ipynb").exists()
        assert (copies / "01-idea.ipynb").exists() == edited


def test_without_a_built_book_one_line_says_what_to_do(extension, tmp_path):
    with pytest.raises(SystemExit, match="make book"):
        extension("lab").copy_pages(tmp_path / "none", tmp_path / "notebooks")
    assert not (tmp_path / "notebooks").exists()
