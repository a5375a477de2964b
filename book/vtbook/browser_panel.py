"""Panels that run in the reader's browser: a template, a style and a script, filled in."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Template
from typing import Any

COMMENTS = re.compile(r"^ */\*.*?\*/\n", re.MULTILINE | re.DOTALL)
STATIC = Path(__file__).resolve().parents[1] / "_static"


def panel(
    name: str,
    setup: Mapping[str, Any],
    scripts: Sequence[str] = (),
    styles: Sequence[str] = (),
    **shown: str | int,
) -> str:
    """HTML of a panel in ``book/_static``: where its script starts, and what its template names.

    scripts: files that stand before the panel's own; styles: files in place of its own.
    """
    return Template(static(f"{name}.html")).substitute(
        style="\n".join(map(lean, styles or (f"{name}.css",))),
        script="\n".join(map(lean, (*scripts, f"{name}.js"))),
        setup=json.dumps(setup, separators=(",", ":")).replace("<", "\\u003c"),  # as HTML wants it
        **shown,
    )


def static(name: str) -> str:
    """The text of a file of ``book/_static``."""
    return (STATIC / name).read_text(encoding="utf-8")


def lean(name: str) -> str:
    """The same without indentation and without comments that have lines of their own."""
    return re.sub(r"^ +", "", COMMENTS.sub("", static(name)), flags=re.MULTILINE)
