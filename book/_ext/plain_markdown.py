"""A page's MyST as the Markdown that every Jupyter reads: values, numbers and links filled in.

JupyterLab, code hosts and editors render plain Markdown alone. Of MyST this knows what the pages
use; a directive or a role that it does not know is an error, so that none is left for a reader.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

from nbformat import NotebookNode
from sphinx import addnodes
from sphinx.util.docutils import new_document

FENCE = re.compile(r"^(`{3,}|:{3,})(?:\{([\w-]+)\})?(.*)$")
OPTION = re.compile(r"^:([\w-]+):\s*(.*)$")
TARGET = re.compile(r"^\([\w-]+\)=\n?", re.MULTILINE)
ROLE = re.compile(r"\{([\w:]+)\}(`+)(.+?)\2", re.DOTALL)
EQUATION = re.compile(r"^( *)\$\$ \((\S+)\)$", re.MULTILINE)
TAG = re.compile(r"\\tag\{(eq-[\w-]+)\}")
FORMULA = re.compile(r"(\$\$?)[^$]+\1")
SPAN = re.compile(r"\[([^\[\]]*(?:\[[^\]]*\][^\[\]]*)*)\]\{\.in-(\d)\}", re.DOTALL)
GLUED = "application/papermill.record/text/plain"  # the type of a number for the prose
GAP = "&nbsp;" * 4  # by which a step of an algorithm stands to the right


def is_page(docname: str) -> bool:
    """Whether a page is one that a reader opens in JupyterLab; the reference is no such page."""
    return not docname.endswith(("/api", "/references"))


def file_name(env: Any, docname: str) -> str:
    """The notebook's name, by which a list of files has the book's order: 03-recommended.ipynb."""
    place = list(env.collect_relations()).index(docname)
    return f"{place:02d}-{docname.rpartition('/')[2]}.ipynb"


class Filling:
    """What a page's source leaves to the book: numbers, texts of references, other files."""

    def __init__(self, app: Any, docname: str, page: NotebookNode) -> None:
        self.app, self.env, self.docname = app, app.env, docname
        self.folder = Path(app.env.doc2path(docname)).parent
        self.macros = app.config.mathjax3_config["tex"]["macros"]
        found = app.env.get_doctree(docname).findall(addnodes.pending_xref)
        self.references = {node.rawsource.strip(":"): node for node in found}
        self.glued = {
            output.metadata["scrapbook"]["name"]: ast.literal_eval(output.data[GLUED])
            for cell in page.cells
            for output in cell.get("outputs", ())
            if GLUED in output.get("data", ())
        }

    def number(self, label: str) -> str:
        """What a figure, a table, a listing or an equation is called: "Figure 6.2" or "5.1"."""
        for kinds in self.env.toc_fignumbers.values():
            for kind, numbers in kinds.items():
                for name in {label, f"equation-{label}"} & numbers.keys():
                    form = self.app.config.numfig_format.get(kind, "%s")
                    return form % ".".join(map(str, numbers[name]))
        raise ValueError(f"{self.docname} names {label!r}, which has no number")

    def link(self, role: str, content: str) -> str:
        """The Markdown of a role: a number from a cell, or a reference."""
        if role == "glue:text":
            return self.glued[content]
        node = self.references[f"{role}:`{content}`"]
        document = new_document("reference")
        document += node.deepcopy()
        self.env.resolve_references(document, self.docname, self.app.builder)
        to = f"{self.docname.rpartition('/')[0]}/{node['reftarget']}"
        if node["reftype"] == "doc" and is_page(to):
            return f"[{document.astext()}]({file_name(self.env, to)})"
        return document.astext()


def plain(text: str, filling: Filling) -> str:
    """A cell of MyST as plain Markdown; ValueError names a directive that is not known."""
    lines, parts = text.split("\n"), []
    while lines:
        line = lines.pop(0)
        fence = FENCE.match(line)
        if fence is None:
            parts.append(line)
            continue
        marks, name, title = fence.groups()
        closing = re.compile(rf"^{marks[0]}{{{len(marks)},}}\s*$")
        end = next(i for i, line in enumerate(lines) if closing.match(line))
        body, lines = lines[:end], lines[end + 1 :]
        if name is None:
            parts += [line, *body, marks]
        else:
            parts.append(_directive(name, title.strip(), body, filling))
    return _inline("\n".join(parts), filling).strip("\n")


def _directive(name: str, title: str, body: list[str], filling: Filling) -> str:
    options: dict[str, str] = {}
    while body and (option := OPTION.match(body[0])):
        options[option[1]] = option[2]
        body.pop(0)
    inner = "\n".join(body).strip("\n")
    if name == "admonition" and "dropdown" in options.get("class", ""):
        summary = f"<details><summary>{title}</summary>"
        return f"{summary}\n\n{plain(inner, filling)}\n\n</details>"
    if name == "admonition":
        # a formula is typeset as it stands, with the marks of a quotation that it goes over
        text = FORMULA.sub(lambda match: " ".join(match[0].split()), plain(inner, filling))
        box = f"**{title}**\n\n{text}"
        return "\n".join(f"> {line}".rstrip() for line in box.split("\n"))
    if name == "table":
        return f"{caption(options.get('name'), title, filling)}\n\n{plain(inner, filling)}"
    if name == "glossary":
        entries = [entry.split("\n", 1) for entry in re.split(r"\n\n(?=\S)", inner)]
        return "\n\n".join(f"**{term}** {' '.join(text.split())}" for term, text in entries)
    if name == "literalinclude":
        text = (filling.folder / title).read_text(encoding="utf-8")
        code = f"```{options['language']}\n{text}```"
        return f"{caption(options['name'], options['caption'], filling)}\n\n{code}"
    raise ValueError(f"pages as notebooks do not know the directive {name!r}")


def caption(label: str | None, text: str, filling: Filling) -> str:
    """A caption with its number, for the figure, table or listing of that label."""
    return f"**{filling.number(label)}.** {text}" if label else f"**{text}**"


def _inline(text: str, filling: Filling) -> str:
    """Roles, targets, numbers of equations and macros of formulas; code stays as it is."""
    text = TARGET.sub("", text)
    text = EQUATION.sub(r"\1\\tag{\2}\n\1$$", text)
    text = TAG.sub(lambda match: rf"\tag{{{filling.number(match[1])}}}", text)
    text = SPAN.sub(lambda match: GAP * int(match[2]) + match[1], text)
    text = ROLE.sub(lambda match: filling.link(match[1], " ".join(match[3].split())), text)
    for name, meaning in filling.macros.items():
        text = re.sub(rf"\\{name}(?![A-Za-z])", lambda _, meaning=meaning: meaning, text)
    return text
