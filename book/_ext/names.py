"""Sphinx extension: names of the library in the text lead to its reference."""

from __future__ import annotations

import pkgutil
import re
from typing import Any

from docutils import nodes
from sphinx.util import logging
from sphinx.util.nodes import make_refnode

LOGGER = logging.getLogger(__name__)

NAME = re.compile(r"(vtlib|vtlab)(\.\w+)+")


def home(name: str) -> str | None:
    """Where the code defines what has this name, and not where it is passed on."""
    try:
        thing = pkgutil.resolve_name(name)
    except (AttributeError, ImportError):
        return None
    return f"{thing.__module__}.{thing.__qualname__}" if hasattr(thing, "__qualname__") else name


def target(objects: dict[str, Any], text: str) -> str | None:
    """The documented object that a piece of code in the text names, if any."""
    name = "Settings" if text.startswith("Settings.") else text.partition("(")[0]
    candidates = (f"{start}{name}" for start in ("", "vtlib.", "vtlab.", "vtlib.transfer."))
    homes = (home(x) for x in candidates if NAME.fullmatch(x))
    return next((x for x in homes if x in objects), None)


def link_names(app: Any, doctree: nodes.document, docname: str) -> None:
    """Lead every name of the library in the text to its place in the reference."""
    objects = app.env.get_domain("py").objects
    for literal in list(doctree.findall(nodes.literal)):
        if isinstance(literal.parent, nodes.reference):
            continue
        text = literal.astext()
        if name := target(objects, text):
            place = objects[name]
            where = place.docname, place.node_id
            link = make_refnode(app.builder, docname, *where, literal.deepcopy(), name)
            literal.replace_self(link)
        elif NAME.fullmatch(text) and home(text) is None:
            LOGGER.warning("the code has no %s", text, location=literal)


def setup(app: Any) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("doctree-resolved", link_names)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
