"""Sphinx extension: the ``gallery`` directive shows every figure of the book as a thumbnail.

The thumbnails are made while the book is written, from what the pages have drawn: a still figure's
picture, or the one that a figure's sliders show first.
"""

from __future__ import annotations

import io
import json
import re
import textwrap
import unicodedata
from base64 import b64decode
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape, unescape
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive
from myst_nb.sphinx_ import NbMetadataCollector
from PIL import Image
from sphinx import addnodes

PAGE = "book/gallery"
WIDTH = 480  # pixels, twice what a thumbnail takes on the page
COLOURS = 64
GREEK = {  # by their names in TeX
    name.rsplit(" ", 1)[1].lower(): chr(code)
    for code in range(0x3B1, 0x3CA)
    if (name := unicodedata.name(chr(code))) and "FINAL" not in name
} | {"lambda": "λ", "varepsilon": "ε"}
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
VIEW = "application/vnd.jupyter.widget-view+json"
PICTURE = re.compile(r'<img alt="(.*?)".*?src="data:image/png;base64,(.*?)"', re.DOTALL)


class GalleryNode(nodes.General, nodes.Element):
    """Where the gallery is to stand."""


class Gallery(Directive):
    """The gallery, without arguments or content."""

    def run(self) -> list[nodes.Node]:
        """Leave a mark; all pages have to be read before it can be filled."""
        return [GalleryNode()]


@dataclass(frozen=True)
class Shown:
    """A figure: its target on its page, its number, its caption, and its picture."""

    target: str
    number: str
    caption: str
    alt: str
    png: bytes


def in_order(env: Any, docname: str) -> Iterator[str]:
    """Pages of the book as the table of contents has them, from one of them on."""
    yield docname
    for child in env.toctree_includes.get(docname, ()):
        yield from in_order(env, child)


def numbered(env: Any) -> dict[str, str]:
    """The number of each figure of the book by its target."""
    pages = (page.get("figure", {}) for page in env.toc_fignumbers.values())
    return {x: ".".join(map(str, number)) for page in pages for x, number in page.items()}


def caption_of(figure: nodes.figure, numbers: dict[str, str]) -> str:
    """The first sentence of a figure's caption as plain text, without the thesis' number."""
    caption = figure.next_node(nodes.caption).deepcopy()
    for other in list(caption.findall(addnodes.pending_xref)):
        if other["reftarget"] in numbers:
            other.replace_self(nodes.Text(f"Figure {numbers[other['reftarget']]}"))
    words = " ".join(plain(caption.astext()).split())
    sentence = re.split(r"(?<=[a-z)\d])[.;] ", re.sub(r"^\(.*?\) ", "", words))[0]
    return textwrap.shorten(sentence.rstrip("."), 120, placeholder=" …", break_on_hyphens=False)


def plain(text: str) -> str:
    """Text with its formulas in letters: Greek ones by their names, digits lowered or raised.

    Lowered words stay as ``_{word}``.
    """
    text = re.sub(r"\^\{?(-?\d+)\}?", lambda found: found[1].translate(RAISED), text)
    text = re.sub(r"\beq-(\d)-(\d+)", r"equation (\1.\2)", text)
    text = re.sub(r"_\{?(\d)\}?", lambda found: chr(0x2080 + int(found[1])), text)
    text = re.sub(r"\\([a-z]+)", lambda found: GREEK.get(found[1], ""), text)
    text = re.sub(r"_\{?([^\W_]+)\}?", r"_{\1}", text)
    return re.sub(r"(_\{\w+\})|\\.|[_^{}]", r"\1", text)


def first_picture(state: dict[str, Any], model: str) -> str:
    """HTML of the picture that a panel of sliders shows before any is moved."""
    values = state[model]["state"]
    if values["_model_name"] == "HTMLModel":
        return values["value"]
    children = [one.removeprefix("IPY_MODEL_") for one in values["children"]]
    if values["_model_name"] == "StackModel":
        return first_picture(state, children[values["selected_index"]])
    boxes = (one for one in children if "children" in state[one]["state"])
    pictures = [one for one in children if state[one]["state"]["_model_name"] == "HTMLModel"]
    return first_picture(state, next(iter([*boxes, *pictures])))


def picture_of(app: Any, docname: str, figure: nodes.figure) -> tuple[str, bytes] | None:
    """Description and PNG of what a figure shows, None for one without a picture."""
    for raw in figure.findall(nodes.raw):
        found = re.search(rf'type="{re.escape(VIEW)}">(.*?)</script>', raw.astext(), re.DOTALL)
        if found:
            _, script = NbMetadataCollector.get_js_files(app.env, docname)["ipywidgets_state"]
            state = json.loads(script["body"])["state"]
            html = first_picture(state, json.loads(found[1])["model_id"])
            alt, data = PICTURE.search(html).groups()
            return unescape(alt), b64decode(data)
    image = figure.next_node(nodes.image)
    if image is None:
        return None
    return image.get("alt", ""), (Path(app.srcdir) / image["uri"]).read_bytes()


def figures(app: Any, docname: str, numbers: dict[str, str]) -> Iterator[Shown]:
    """The figures of one page, in its order, with the numbers of all."""
    for figure in app.env.get_doctree(docname).findall(nodes.figure):
        target = next((one for one in figure["ids"] if one in numbers), None)
        picture = picture_of(app, docname, figure) if target else None
        if picture:
            words = caption_of(figure, numbers)
            yield Shown(figure["ids"][0], numbers[target], words, *picture)


def thumbnail(png: bytes) -> bytes:
    """A small copy of a picture on white, with few colours."""
    picture = Image.open(io.BytesIO(png)).convert("RGBA")
    paper = Image.new("RGBA", picture.size, "white")
    paper.alpha_composite(picture)
    paper.thumbnail((WIDTH, WIDTH), Image.Resampling.LANCZOS)
    out = io.BytesIO()
    paper.convert("RGB").quantize(COLOURS).save(out, format="png", optimize=True)
    return out.getvalue()


def entry(app: Any, here: str, docname: str, shown: Shown) -> str:
    """HTML of one thumbnail, whose file is written beside the book's other pictures."""
    file = f"_images/thumbnails/{shown.target}.png"
    path = Path(app.outdir) / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(thumbnail(shown.png))
    with Image.open(path) as picture:
        width, height = picture.size
    link = f"{app.builder.get_relative_uri(here, docname)}#{shown.target}"
    caption = re.sub(r"_\{(\w+)\}", r"<sub>\1</sub>", escape(shown.caption))
    return (
        f'<li><a href="{link}"><img src="{"../" * here.count("/")}{file}" loading="lazy" '
        f'width="{width}" height="{height}" alt="{escape(shown.alt)}">'
        f"<span>Figure {shown.number}: {caption}</span></a></li>"
    )


def fill(app: Any, doctree: nodes.document, docname: str) -> None:
    """Put the thumbnails where the mark is."""
    numbers = numbered(app.env)
    for mark in list(doctree.findall(GalleryNode)):
        entries = [
            entry(app, docname, page, shown)
            for page in in_order(app.env, app.config.root_doc)
            for shown in figures(app, page, numbers)
        ]
        html = f'<ul class="gallery">\n{"".join(entries)}\n</ul>'
        mark.replace_self(nodes.raw("", html, format="html"))


def outdated(app: Any, env: Any, added: set, changed: set, removed: set) -> list[str]:
    """Its page is written anew with every build: any page may have drawn something else."""
    return [PAGE]


def setup(app: Any) -> dict[str, Any]:
    """Register with Sphinx."""
    app.add_node(GalleryNode)
    app.add_directive("gallery", Gallery)
    app.connect("doctree-resolved", fill)
    app.connect("env-get-outdated", outdated)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
