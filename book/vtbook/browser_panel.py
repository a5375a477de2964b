"""Panels that run in the reader's browser: a template, a style and a script, filled in."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Template
from typing import Any

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
        style="\n".join(map(static, styles or (f"{name}.css",))),
        script="\n".join(map(static, (*scripts, f"{name}.js"))),
        setup=json.dumps(setup, separators=(",", ":")).replace("<", "\\u003c"),  # as HTML wants it
        **shown,
    )


def static(name: str) -> str:
    """The text of a file of ``book/_static``."""
    return (STATIC / name).read_text(encoding="utf-8")
