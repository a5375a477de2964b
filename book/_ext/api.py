"""Sphinx extension: the reference of the library, from its docstrings.

A page says which modules it documents, ``<!-- modules: vtlab.envs.* -->``; new files that match
are documented without further work, but for names after an exclamation mark. Docstrings are plain
text with a little Markdown, as Gymnasium has it, and become what Sphinx reads; each function is
followed by its equations.
"""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Iterator
from importlib import import_module
from pkgutil import walk_packages
from typing import Any

import attrs
from equations import EQUATIONS, formulas
from sphinx.ext.autosummary import Autosummary

MODULES = re.compile(r"<!-- modules:(.*?)-->", re.DOTALL)
FORMULAS = formulas()


def modules() -> list[str]:
    """Dotted names of the public modules of the two packages, packages before what they hold."""
    names = ["vtlib", "vtlab"]
    for package in tuple(names):
        path = import_module(package).__path__
        names += [module.name for module in walk_packages(path, f"{package}.")]
    return sorted(name for name in names if "._" not in name)


def matching(patterns: str) -> list[str]:
    """Modules that a pattern names and none after a "!" does, in the order of the patterns."""
    excluded = [x[1:] for x in patterns.split() if x.startswith("!")]
    names = dict.fromkeys(name for x in patterns.split() for name in fnmatch.filter(modules(), x))
    return [name for name in names if not any(fnmatch.fnmatchcase(name, x) for x in excluded)]


def sections(match: re.Match) -> str:
    """Markdown of a table of modules, and of the section of each: what it defines itself."""
    names = matching(match[1])
    rows = "\n".join(f"   {name}" for name in names)
    parts = [f"```{{eval-rst}}\n.. modules::\n   :nosignatures:\n\n{rows}\n```\n"]
    options = "   :members:\n   :ignore-module-all:\n"
    for name in names:
        directive = f"```{{eval-rst}}\n.. automodule:: {name}\n{options}```\n"
        parts.append(f"## {name}\n\n{directive}")
    return "\n".join(parts)


def list_modules(app: Any, docname: str, source: list[str]) -> None:
    """Put the modules that a page asks for in the place of its comment."""
    source[0] = MODULES.sub(sections, source[0])


class Modules(Autosummary):
    """A table of modules, also where a package offers a function by the name of its module."""

    def import_by_name(self, name: str, prefixes: list[str | None]) -> tuple[str, Any, Any, str]:
        """The module, not what its package has under that name."""
        return name, import_module(name), None, name


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


def table(rows: list[str]) -> Iterator[str]:
    """A Markdown table as Sphinx reads it."""
    yield from ("", ".. list-table::", "   :header-rows: 1", "")
    for row in (rows[0], *rows[2:]):
        for index, cell in enumerate(re.split(r"(?<!\\)\|", row.strip())[1:-1]):
            yield f"   {'-' if index else '* -'} {inline(cell.strip())}".replace("   - ", "     - ")
    yield ""


def converted(lines: list[str]) -> Iterator[str]:
    """Lines of a docstring in the notation that Sphinx reads."""
    rows: list[str] = []
    for line in (*lines, ""):
        if line.lstrip().startswith("|"):
            rows.append(line)
            continue
        if rows:
            yield from table(rows)
            rows = []
        heading = re.fullmatch(r"##+ (.*)", line.strip())
        yield from ("", f".. rubric:: {heading[1]}", "") if heading else (inline(line),)


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
    lines[:] = [*converted(lines), *equations_of(name)]


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
    app.setup_extension("sphinx.ext.autosummary")
    app.add_directive("modules", Modules)
    app.setup_extension("sphinx.ext.napoleon")
    app.connect("source-read", list_modules)
    app.connect("autodoc-process-docstring", read_docstring)
    app.connect("autodoc-process-signature", write_defaults)
    app.connect("autodoc-skip-member", skip_field)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
