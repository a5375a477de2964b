"""A page's MyST as the Markdown that every Jupyter reads: values, numbers and links filled in.

JupyterLab, code hosts and editors render plain Markdown alone. Of MyST this knows what the pages
use; a directive or a role that it does not know is an error, so that none is left for a reader.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from attrs import frozen

FENCE = re.compile(r"^(`{3,}|:{3,})(?:\{([\w-]+)\})?(.*)$")
OPTION = re.compile(r"^:([\w-]+):\s*(.*)$")
TARGET = re.compile(r"^\([\w-]+\)=\n?", re.MULTILINE)
ROLE = re.compile(r"\{([\w:]+)\}(`+)(.+?)\2", re.DOTALL)
EQUATION = re.compile(r"^( *)\$\$ \((\S+)\)$", re.MULTILINE)
TAG = re.compile(r"\\tag\{(eq-[\w-]+)\}")
FORMULA = re.compile(r"(\$\$?)[^$]+\1")
SPAN = re.compile(r"\[([^\[\]]*(?:\[[^\]]*\][^\[\]]*)*)\]\{\.in-(\d)\}", re.DOTALL)
GAP = "&nbsp;" * 4  # by which a step of an algorithm stands to the right


@frozen
class Filling:
    """What a page's source leaves to the book: texts by their role and content, and numbers.

    link(role, content) tells the Markdown of a reference; number(label) tells what a figure, a
    table, a listing or an equation is called, such as "Figure 6.2" or "5.1"; read(path) gives the
    text of a file that the page includes; macros are those of its formulas, by name.
    """

    link: Callable[[str, str], str]
    number: Callable[[str], str]
    read: Callable[[str], str]
    macros: Mapping[str, str]


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
        body = _until(lines, marks)
        if name is None:
            parts += [line, *body, marks]
        else:
            parts.append(_directive(name, title.strip(), body, filling))
    return _inline("\n".join(parts), filling).strip("\n")


def _until(lines: list[str], marks: str) -> list[str]:
    """Take the lines up to the one that closes a fence, which goes with them."""
    closing = re.compile(rf"^{marks[0]}{{{len(marks)},}}\s*$")
    end = next(i for i, line in enumerate(lines) if closing.match(line))
    body = lines[:end]
    del lines[: end + 1]
    return body


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
        code = f"```{options['language']}\n{filling.read(title)}```"
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
