"""Sphinx extension: print has figures in lines and letters.

`vtbook.plots` hands those over in the metadata of the figure's output, which the execution cache
keeps. Here they become files beside the picture, which pdf.py prints.
"""

from __future__ import annotations

import hashlib
import re
from base64 import b64decode
from pathlib import Path
from typing import Any

from in_parallel import executed

IMAGE = re.compile(r'<img\b[^>]*? src="([^"]*?_images/)([0-9a-f]{64})\.png"[^>]*>')


def pictures(app: Any, docname: str) -> dict[str, dict[str, str]]:
    """What a page's figures have drawn beside their pictures, by the digests of these."""
    page = executed(app, docname)
    outputs = [x for cell in page.cells for x in cell.get("outputs", ())] if page else []
    return {
        hashlib.sha256(b64decode(output.data["image/png"])).hexdigest(): drawing
        for output in outputs
        if (drawing := output.get("metadata", {}).get("image/png"))
    }


def offer(app: Any, docname: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    """Write what a page's figures have drawn for others, and name it beside their pictures."""
    if doctree is None:  # a page that Sphinx makes has no figures
        return
    drawings, images = pictures(app, docname), Path(app.outdir) / "_images"
    images.mkdir(exist_ok=True)

    def named(image: re.Match[str]) -> str:
        folder, digest = image.groups()
        drawing, tag, name = drawings.get(digest, {}), image[0], digest[:32]
        if "vector" in drawing:
            (images / f"{name}.svg").write_text(drawing["vector"], encoding="utf-8")
            tag = tag.replace("<img", f'<img data-vector="{folder}{name}.svg"', 1)
        return tag

    context["body"] = IMAGE.sub(named, context["body"])


def setup(app: Any) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("html-page-context", offer)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
