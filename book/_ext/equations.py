"""Sphinx extension: an equation leads to the code that computes it, and names in the text do, too.

``EQUATIONS`` is the one list of which function computes which equation; the pages show it under the
equations, and the reference of the library beside the functions.
"""

from __future__ import annotations

import pkgutil
import re
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.util import logging
from sphinx.util.nodes import make_refnode

LOGGER = logging.getLogger(__name__)
BOOK = Path(__file__).resolve().parents[1]

# Definitions that nothing computes, or the page itself, are not listed.
EQUATIONS = {
    "eq-2-6": ("vtlab.envs.planning.GridPlan.value",),
    "eq-2-7": ("vtlab.envs.planning.GridPlan.greedy",),
    "eq-2-8": ("vtlab.envs.planning.sweep",),
    "eq-2-12": ("vtlab.bases.RBFLinear.q", "vtlib.qfunctions.MLP.q"),
    "eq-2-15": ("vtlib.td.td_error",),
    "eq-2-17": ("vtlib.priors.kl",),
    "eq-5-2": ("vtlib.transfer.VariationalTransfer.learn", "vtlib.algorithm1.algorithm1"),
    "eq-5-3": ("vtlib.td.mellowmax",),
    "eq-5-4": ("vtlib.td.td_cotangent", "vtlib.td.td_gradients"),
    "eq-5-5": ("vtlib.priors.sources_mean_and_spread",),
    "eq-5-6": ("vtlib.priors.sources_mean_and_spread", "vtlib.priors.covariance_factor"),
    "eq-5-7": ("vtlib.priors.kl", "vtlib.priors.pairwise_kl"),
    "eq-5-8": ("vtlib.priors.GaussianPrior.pull",),
    "eq-5-9": ("vtlib.posteriors.dense.Dense",),
    "eq-5-10": ("vtlib.transfer.VariationalTransfer.learn",),
    "eq-5-11": ("vtlib.posteriors.dense.Dense",),
    "eq-5-12": ("vtlib.priors.kl_bound",),
    "eq-5-13": ("vtlib.priors.kl_bound",),
    "eq-5-14": ("vtlib.priors.responsibilities",),
    "eq-5-15": ("vtlib.priors.responsibilities",),
}
NAME = re.compile(r"(vtlib|vtlab)(\.\w+)+")
LABELLED = re.compile(r"^ *\$\$\n([^$]*)\n *\$\$ \((eq-\d-\d+)\)", re.MULTILINE)


def formulas() -> dict[str, str]:
    """LaTeX of every equation that carries one of the thesis' numbers, by label."""
    pages = [page.read_text(encoding="utf-8") for page in sorted(BOOK.glob("*.md"))]
    equations = (equation for page in pages for equation in LABELLED.findall(page))
    return {label: "\n".join(map(str.strip, tex.splitlines())) for tex, label in equations}


def add_code_lines(app: Any, doctree: nodes.document) -> None:
    """Name the functions under each equation that they compute."""
    for block in list(doctree.findall(nodes.math_block)):
        if names := EQUATIONS.get(block.get("label")):
            line = nodes.paragraph("", "In code: ", classes=["in-code"])
            for index, name in enumerate(names):
                line += [nodes.Text(", ")] * bool(index) + [nodes.literal(text=name)]
            block.parent.insert(block.parent.index(block) + 1, line)


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
    app.connect("doctree-read", add_code_lines)
    app.connect("doctree-resolved", link_names)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
