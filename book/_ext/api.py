"""Sphinx extension: the reference of the library, from its docstrings.

Docstrings are plain text with code in backticks and become what Sphinx reads; the equations that
they name are linked.
"""

from __future__ import annotations

import re
from typing import Any


def inline(line: str) -> str:
    """One line of plain text with code in backticks, safe for Sphinx."""
    parts = re.split(r"`+([^`]+)`+", line)
    parts[1::2] = (f"``{code}``" for code in parts[1::2])
    for index, text in enumerate(parts[::2]):
        text = re.sub(r"[\\|*]|_(?!\w)", r"\\\g<0>", text)
        parts[2 * index] = re.sub(r"\beq\. (\d)\.(\d+)", r"eq. :eq:`eq-\1-\2`", text)
    return "".join(parts)


def read_docstring(
    app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]
) -> None:
    """Convert a docstring."""
    lines[:] = map(inline, lines)


def write_defaults(
    app: Any, what: str, name: str, obj: Any, options: Any, signature: str | None, returns: str
) -> tuple[str | None, str]:
    """Write a default that attrs makes anew for each object as dots."""
    return signature and signature.replace("= NOTHING", "= ..."), returns


def skip_field(app: Any, what: str, name: str, obj: Any, skip: bool, options: Any) -> bool | None:
    """Leave out what a named tuple says of its fields, 'Alias for field number 0'."""
    alias = (getattr(obj, "__doc__", None) or "").startswith("Alias for field number")
    return True if alias else None


def setup(app: Any) -> dict[str, Any]:
    """Register with Sphinx."""
    app.setup_extension("sphinx.ext.autodoc")
    app.connect("autodoc-process-docstring", read_docstring)
    app.connect("autodoc-process-signature", write_defaults)
    app.connect("autodoc-skip-member", skip_field)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
