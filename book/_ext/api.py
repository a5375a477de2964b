"""Sphinx extension: the reference of the library, from its docstrings.

The page says what it documents, ``<!-- reference: solve vtlib.td -->``: names that ``vtlib``
offers, and modules without these names. Docstrings are plain text with code in backticks and become
what Sphinx reads; each function is followed by its equations.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import attrs
from equations import EQUATIONS, formulas

import vtlib

ASKED = re.compile(r"<!-- reference:(.*?)-->", re.DOTALL)
FORMULAS = formulas()


def directive(kind: str, name: str, *options: str) -> str:
    """Markdown by which Sphinx documents one thing."""
    lines = (f".. auto{kind}:: {name}", *(f"   :{x}" for x in options))
    return "\n".join(["```{eval-rst}", *lines, "```"])


def public(name: str) -> str:
    """Markdown of a class or function that the library offers, under the name of its home."""
    thing = getattr(vtlib, name)
    kind = "class" if isinstance(thing, type) else "function"
    members = ("members:",) if kind == "class" else ()
    return directive(kind, f"{thing.__module__}.{name}", *members)


def module(name: str) -> str:
    """Markdown of what a module defines and the library does not offer by itself."""
    others = "exclude-members: " + ", ".join(vtlib.__all__)
    text = directive("module", name, "members:", "ignore-module-all:", others)
    return f"### {name}\n\n{text}"


def described(match: re.Match) -> str:
    """Markdown of everything that a page asks for."""
    return "\n\n".join(module(x) if "." in x else public(x) for x in match[1].split())


def write_reference(app: Any, docname: str, source: list[str]) -> None:
    """Put what a page asks for in the place of its comment."""
    source[0] = ASKED.sub(described, source[0])


def inline(line: str) -> str:
    """One line of plain text with code in backticks, safe for Sphinx."""
    parts = re.split(r"(`+[^`]+`+)", line)
    for index, part in enumerate(parts):
        if index % 2:
            parts[index] = f"``{part.strip('`')}``"
        else:
            part = part.replace("\\", "\\\\").replace("|", "\\|")
            part = re.sub(r"(?<=\w)_(?!\w)", r"\\_", part)
            if part.count("*") % 2:  # a product or an argument, not a word in italics
                part = part.replace("*", "\\*")
            parts[index] = re.sub(r"\beq\. (\d)\.(\d+)", known_equation, part)
    return "".join(parts)


def known_equation(match: re.Match) -> str:
    """A reference to an equation of the book, or the words as they were."""
    label = f"eq-{match[1]}-{match[2]}"
    return f"eq. :eq:`{label}`" if label in FORMULAS else match[0]


def equations_of(name: str) -> Iterator[str]:
    """Lines with the equations that a documented object computes, in the thesis' order."""
    for label in (label for label, names in EQUATIONS.items() if name in names):
        yield from ("", f"Equation :eq:`{label}`:", "", ".. math::", "")
        yield from (f"   {line}" for line in FORMULAS[label].splitlines())
    yield ""


def read_docstring(
    app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]
) -> None:
    """Convert a docstring and add its equations."""
    lines[:] = [*map(inline, lines), *equations_of(name)]


def write_defaults(
    app: Any, what: str, name: str, obj: Any, options: Any, signature: str, returns: str
) -> tuple[str, str] | None:
    """Name the defaults of an attrs class, whose generated code looks them up."""
    if not (what == "class" and attrs.has(obj) and signature):
        return None
    fields = attrs.fields_dict(obj)
    generated = re.compile(r"attr_dict\['(\w+)'\]\.default")
    signature = generated.sub(lambda match: repr(fields[match[1]].default), signature)
    return signature.replace("= NOTHING", "= ..."), returns


def skip_field(app: Any, what: str, name: str, obj: Any, skip: bool, options: Any) -> bool | None:
    """Leave out what a named tuple says of its fields, 'Alias for field number 0'."""
    alias = (getattr(obj, "__doc__", None) or "").startswith("Alias for field number")
    return True if alias else None


def setup(app: Any) -> dict[str, Any]:
    """Register with Sphinx."""
    app.setup_extension("sphinx.ext.autodoc")
    app.setup_extension("sphinx.ext.napoleon")
    app.connect("source-read", write_reference)
    app.connect("autodoc-process-docstring", read_docstring)
    app.connect("autodoc-process-signature", write_defaults)
    app.connect("autodoc-skip-member", skip_field)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
