"""Sphinx extension: each page is a notebook, too, as the built page shows it.

A notebook's text is plain Markdown with the page's numbers, references and captions filled in, and
its cells have the outputs of the build, so that it reads as the page does wherever notebooks are
shown, and before anything has run. What the page folds is folded.
``lab.py`` copies them to the folder where a reader changes them; no notebook is ever written back.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat
from docutils import nodes
from in_parallel import executed
from myst_nb.sphinx_ import NbMetadataCollector
from nbformat import NotebookNode
from plain_markdown import Filling, caption, file_name, is_page, plain

FOLDER = "_sources/notebooks"  # of the built book
NEEDS = (
    "A page of *Variational Transfer of Value Functions*, with the outputs of the built book. Its "
    "cells run in `make lab`, and wherever `pip install -e . -e book` has installed a checkout of "
    "the repository, whose stored runs they read."
)
KERNEL = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
# A page's prose takes its numbers from glue. A notebook has no such prose and prints the numbers.
PRINT = '''def glue(name, value, display=False):
    """Show a number that the text of the page has from here."""
    print(f"{name}: {value}")'''
STARTING = 6.0  # seconds that a kernel needs to import what pages import
FOLDED = {"remove-cell", "hide-cell", "remove-input", "hide-input"}
HEADING = re.compile(r"^```.*?^```$|^(#+ )", re.DOTALL | re.MULTILINE)  # or code, which has none


def numbered(text: str, sections: Iterator[str]) -> str:
    """Headings with the numbers that they have in the book."""
    return HEADING.sub(lambda match: match[1] + next(sections) if match[1] else match[0], text)


def section_numbers(env: Any, docname: str) -> Iterator[str]:
    """What stands before each heading of a page, in their order."""
    numbers = env.toc_secnumbers.get(docname, {})
    for i, section in enumerate(env.get_doctree(docname).findall(nodes.section)):
        number = numbers.get(f"#{section['ids'][0]}" if i else "", ())
        yield ".".join(map(str, number)) + " " * bool(number)


def code_cells(cell: NotebookNode, filled: Filling) -> Iterator[NotebookNode]:
    """A cell of code as a reader runs it, and below it the caption of its figure."""
    tags = set(cell.metadata.pop("tags", ()))
    figure = cell.metadata.pop("mystnb", {}).get("figure", {})
    cell.metadata = nbformat.from_dict({})
    cell.source = cell.source.replace("from myst_nb import glue", PRINT)
    removed = "remove-output" in tags
    # numbers for the prose, and bars of progress, are no outputs that a notebook shows
    cell.outputs = [
        x
        for x in cell.outputs
        if not (removed or "scrapbook" in x.get("metadata", {}) or x.get("name") == "stderr")
    ]
    if tags & FOLDED:
        # Of a cell without outputs the prose has the numbers already.
        hidden = bool(tags & {"remove-cell", "hide-cell"}) or not cell.outputs
        cell.metadata["jupyter"] = {"source_hidden": True, "outputs_hidden": hidden}
    yield cell
    if figure:
        text = caption(figure["name"], " ".join(figure["caption"].split()), filled)
        yield nbformat.v4.new_markdown_cell(plain(text, filled))


def notebook(app: Any, docname: str) -> NotebookNode:
    """A page and its outputs as a notebook that needs vtlib and what vtlib needs, no more."""
    page, v4 = executed(app, docname), nbformat.v4
    cells = [v4.new_markdown_cell(NEEDS)] if page else []
    if page is None:  # one without cells
        text = Path(app.env.doc2path(docname)).read_text(encoding="utf-8")
        page = v4.new_notebook(metadata=KERNEL, cells=[v4.new_markdown_cell(text)])
    filled, sections = Filling(app, docname, page), section_numbers(app.env, docname)
    for cell in page.cells:
        if cell.cell_type == "code":
            cells += code_cells(cell, filled)
        elif text := plain(numbered(cell.source, sections), filled):
            cells.append(v4.new_markdown_cell(text))
    kept = {x: page.metadata[x] for x in ("kernelspec", "widgets") if x in page.metadata}
    return v4.new_notebook(metadata=kept, cells=cells)


def online(address: str, name: str) -> dict[str, str]:
    """Addresses where a reader runs a page without installing anything, of a book on GitHub."""
    owner = re.fullmatch(r"https://github\.com/([^/]+/[^/]+?)(\.git)?/?", address)
    if owner is None:
        return {}
    return {
        "on Binder": f"https://mybinder.org/v2/gh/{owner[1]}/HEAD?urlpath=lab/tree/notebooks/{name}",
        "in Codespaces": f"https://codespaces.new/{owner[1]}",
    }


def add_note(app: Any, doctree: nodes.document, docname: str) -> None:
    """Say at the end how long the page takes, with links to its notebook and where it runs."""
    data = NbMetadataCollector.get_exec_data(app.env, docname)
    title = doctree.next_node(nodes.title)
    if not data or data.get("runtime") is None or title is None:
        return
    note = nodes.paragraph(classes=["page-note"])
    seconds = 10 * math.ceil((data["runtime"] + STARTING) / 10)
    words = f"{seconds} seconds" if seconds < 90 else f"{math.ceil(seconds / 60)} minutes"
    note += nodes.Text(f"Takes about {words} to run as a ")
    name = file_name(app.env, docname)
    to = f"{'../' * docname.count('/')}{FOLDER}/{name}"
    note += nodes.reference("", "notebook", refuri=to, internal=False)
    for place, to in online(app.config.html_theme_options.get("repository_url", ""), name).items():
        note += [nodes.Text(", "), nodes.reference("", place, refuri=to, internal=False)]
    note += nodes.Text(".")
    title.parent += note


def write_notebook(app: Any, docname: str, template: str, context: dict, doctree: Any) -> None:
    """Put the notebook into the built book, where the theme's download button looks for it."""
    if doctree is None or not is_page(docname):  # one that Sphinx makes is no document
        return
    name = file_name(app.env, docname)
    out = Path(app.outdir) / FOLDER / name
    out.parent.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook(app, docname), out)
    context["ipynb_source"] = f"{FOLDER.partition('/')[2]}/{name}"


def setup(app: Any) -> dict[str, Any]:
    """Register with Sphinx, before the theme fills its buttons."""
    app.connect("doctree-resolved", add_note)
    app.connect("html-page-context", write_notebook, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
