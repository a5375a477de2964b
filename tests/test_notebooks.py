"""The notebooks of the built book: they read as the pages do, and run wherever vtlib is."""

import ast
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import nbformat
import pytest

BOOK = Path(__file__).resolve().parents[1] / "book"
PAGES = sorted(
    path.stem
    for path in BOOK.glob("*.md")
    if "\nkernelspec:" in path.read_text(encoding="utf-8")[:500]
)
TEXTS = ["experiments", "glossary"]
# The packages that come with an installation from a checkout.
BROUGHT = "vtlib vtlab vtbook torch numpy gymnasium scipy xarray attrs matplotlib IPython"
MYST = re.compile(r"\{[a-z]+(?::\w+)?\}`|^[`:]{3,}\{|^\([\w-]+\)=$|\$\$ \(", re.MULTILINE)
MACRO = re.compile(r"\\(?:E|KL|mm|R)(?![A-Za-z])")


@pytest.fixture
def built(book):
    """The only file of a page that the built book has for JupyterLab."""

    def path_of(page):
        (path,) = (book / "_sources" / "notebooks").glob(f"*-{page}.*")
        return path

    return path_of


def read(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    return notebook


def code(notebook) -> str:
    """All cells with code, one after another."""
    return "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "code")


@pytest.mark.parametrize("page", PAGES)
def test_a_page_is_a_valid_notebook_that_needs_vtlib_alone(built, page):
    notebook = read(built(page))
    assert "pip install -e . -e book" in notebook.cells[0].source
    assert "%%" not in code(notebook)
    for node in ast.walk(ast.parse(code(notebook))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            name = getattr(node, "module", node.names[0].name)
            # where the book's kernels have parts of these already, a notebook has to import them
            assert isinstance(node, ast.ImportFrom) or name not in ("scipy", "vtbook", "vtlab")
            assert name.partition(".")[0] in {*BROUGHT.split(), *sys.stdlib_module_names}


@pytest.mark.parametrize("page", [*PAGES, *TEXTS])
def test_the_text_of_a_page_has_no_holes(built, page):
    path = built(page)
    cells = read(path).cells if path.suffix == ".ipynb" else [{"source": path.read_text("utf-8")}]
    for cell in cells:
        if cell.get("cell_type") != "code":
            prose = re.sub(r"^```.*?^```", "", cell["source"], flags=re.DOTALL | re.MULTILINE)
            assert MYST.findall(prose) == []
            assert MACRO.findall(prose) == []
            for name in re.findall(r"\]\(([^)]*\.(?:ipynb|md))\)", prose):
                assert (path.parent / name).exists(), name


@pytest.fixture
def copies(extension, tmp_path, monkeypatch):
    """A built notebook and a text, and a call that copies them."""
    monkeypatch.setenv("JUPYTER_DATA_DIR", str(tmp_path / "data"))
    built, folder = tmp_path / "built", tmp_path / "notebooks"
    built.mkdir()
    v4 = nbformat.v4

    def build(source):
        (built / "06-text.md").write_text(source)
        cells = [
            v4.new_markdown_cell("needs", metadata={"tags": ["needs"]}),
            v4.new_code_cell(source),
        ]
        nbformat.write(v4.new_notebook(cells=cells), built / "00-index.ipynb")

    build("1 + 1")
    copy = extension("lab").copy_pages
    return SimpleNamespace(build=build, folder=folder, copy=lambda: copy(built, folder))


def test_pages_are_copied_again_when_the_book_changes_but_what_a_reader_changed_stays(copies):
    path, text = copies.folder / "00-index.ipynb", copies.folder / "06-text.md"
    assert copies.copy() == []
    run = nbformat.read(path, 4)
    assert [cell.source for cell in run.cells] == ["1 + 1"]  # without what the page needs
    run.cells[0].execution_count = 5
    nbformat.write(run, path)
    assert copies.copy() == []
    assert nbformat.read(path, 4).cells[0].execution_count == 5
    copies.build("2 + 2")
    assert copies.copy() == []
    assert nbformat.read(path, 4).cells[0].source == text.read_text() == "2 + 2"
    run.cells[0].source = "mine"
    nbformat.write(run, path)
    assert copies.copy() == ["00-index.ipynb"]
    copies.build("3 + 3")
    assert copies.copy() == ["00-index.ipynb"]
    assert nbformat.read(path, 4).cells[0].source == "mine"
    assert text.read_text() == "3 + 3"
    path.unlink()
    assert copies.copy() == []
    assert nbformat.read(path, 4).cells[0].source == "3 + 3"


def test_without_a_built_book_one_line_says_what_to_do(extension, tmp_path):
    with pytest.raises(SystemExit, match="make book"):
        extension("lab").copy_pages(tmp_path / "none", tmp_path / "notebooks")
    assert not (tmp_path / "notebooks").exists()
