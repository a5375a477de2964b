"""Sphinx extension: no line ends within the name of an algorithm, such as 1-MGVT."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes

NAME = re.compile(r"\b(\d-MGVT)\b")
AROUND = nodes.paragraph, nodes.caption, nodes.emphasis, nodes.strong, nodes.inline


def keep_whole(app: Any, doctree: nodes.document, _docname: str) -> None:
    """Put each name in the text of a page into an element of its own, for the style to keep."""
    if app.builder.format != "html":
        return
    for text in list(doctree.findall(nodes.Text)):
        if isinstance(text.parent, AROUND) and NAME.search(text):
            parts = [
                nodes.inline("", part, classes=["whole"]) if at % 2 else nodes.Text(part)
                for at, part in enumerate(NAME.split(text))
            ]
            text.parent.replace(text, parts)


def setup(app: Any) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("doctree-resolved", keep_whole)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
