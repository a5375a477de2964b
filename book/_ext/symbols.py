"""Sphinx extension: in the table of symbols, the place that introduces a symbol is a link."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from docutils import nodes

PLACE = re.compile(r"(\(\d\.\d+\)|\b\d(?:\.\d)+\b)")
COLUMN = "introduced"


def places(env: Any) -> dict[str, tuple[str, str]]:
    """Page and anchor of every numbered section and of every equation with a thesis' number."""
    found = {}
    for docname, numbers in env.toc_secnumbers.items():
        for anchor, number in numbers.items():
            found[".".join(map(str, number or ()))] = docname, anchor
    for label, (docname, _) in env.get_domain("math").equations.items():
        if re.fullmatch(r"eq-\d-\d+", label):
            number = label.removeprefix("eq-").replace("-", ".")
            found[f"({number})"] = docname, f"#equation-{label}"
    return found


def cells(table: nodes.table) -> Iterator[nodes.entry]:
    """Cells of the column that says where a symbol is introduced, in tables that have it."""
    header = table.next_node(nodes.thead)
    titles = [entry.astext() for entry in header.findall(nodes.entry)] if header else []
    if COLUMN in titles:
        for row in table.next_node(nodes.tbody).findall(nodes.row):
            yield row.children[titles.index(COLUMN)]


def link_places(app: Any, doctree: nodes.document, docname: str) -> None:
    """Turn each place into a link; a place that the book lacks stays as it is written."""
    found = places(app.env)
    for cell in (cell for table in doctree.findall(nodes.table) for cell in cells(table)):
        for text in list(cell.findall(nodes.Text)):
            parts: list[nodes.Node] = []
            for part in PLACE.split(str(text)):
                if part in found:
                    page, anchor = found[part]
                    address = app.builder.get_relative_uri(docname, page) + anchor
                    parts.append(nodes.reference("", part, refuri=address, internal=True))
                else:
                    parts.append(nodes.Text(part))
            text.parent.replace(text, parts)


def setup(app: Any) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("doctree-resolved", link_places)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
