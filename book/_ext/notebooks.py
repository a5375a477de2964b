"""Sphinx extension: each page offers itself as a notebook and says how long it takes to run."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import jupytext
import nbformat
from docutils import nodes
from myst_nb.sphinx_ import NbMetadataCollector

NEEDS = (
    "This notebook is a page of *Variational Transfer of Value Functions*. It runs in any Jupyter "
    "once `vtlib` is installed from a checkout of the book, whose stored runs it reads: "
    "`pip install -e .`. Marks such as {numref} or {cite} are links of the book; the built page "
    "has them in full."
)
GLUE = re.compile(r"^from myst_nb import glue$", re.MULTILINE)
# The book's prose takes its numbers from glue; a notebook outside the book prints them instead.
PRINT = '''def glue(name, value, display=False):
    """Show a number that the book's text takes from here."""
    print(f"{name}: {value}")'''


def is_page_with_code(path: Path) -> bool:
    """Whether a page of the book has cells."""
    return path.suffix == ".md" and "\nkernelspec:" in path.read_text(encoding="utf-8")[:500]


def notebook(path: Path) -> Any:
    """A page as a notebook without outputs that needs vtlib and what vtlib needs, no more."""
    made = jupytext.read(path, fmt="md:myst")
    made.metadata.pop("jupytext", None)
    for cell in made.cells:
        if cell.cell_type == "code":
            cell.source = GLUE.sub(PRINT, cell.source)
            cell.metadata.pop("mystnb", None)
    made.cells.insert(0, nbformat.v4.new_markdown_cell(NEEDS))
    for index, cell in enumerate(made.cells):
        cell.id = f"cell-{index}"  # the same file from the same page
    return made


def in_words(seconds: float) -> str:
    """A duration as a reader wants it."""
    if seconds < 1.5:
        return "about a second"
    if seconds < 90:
        return f"{seconds:.0f} seconds"
    return f"{seconds / 60:.0f} minutes"


def add_note(app: Any, doctree: nodes.document, docname: str) -> None:
    """Say under the title how long the page takes, with a link to its notebook."""
    data = NbMetadataCollector.get_exec_data(app.env, docname)
    title = doctree.next_node(nodes.title)
    if not data or data.get("runtime") is None or title is None:
        return
    note = nodes.paragraph(classes=["page-note"])
    note += nodes.Text(f"Takes {in_words(data['runtime'])} to run as a ")
    up = "../" * docname.count("/")
    note += nodes.reference("", "notebook", refuri=f"{up}_sources/{docname}.ipynb", internal=False)
    note += nodes.Text(".")
    title.parent.insert(title.parent.index(title) + 1, note)


def write_notebook(app: Any, docname: str, template: str, context: dict, doctree: Any) -> None:
    """Put the notebook beside the page's source, where the theme's download button looks."""
    path = Path(app.env.doc2path(docname)) if docname in app.env.found_docs else None
    if app.builder.format != "html" or path is None or not is_page_with_code(path):
        return
    out = Path(app.outdir) / "_sources" / f"{docname}.ipynb"
    out.parent.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook(path), out)
    context["ipynb_source"] = f"{docname}.ipynb"


def setup(app: Any) -> dict[str, Any]:
    """Register with Sphinx, before the theme fills its buttons."""
    app.connect("doctree-resolved", add_note)
    app.connect("html-page-context", write_notebook, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
