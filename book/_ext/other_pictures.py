"""Sphinx extension: telephones and print have figures that were drawn for them.

`vtbook.plots` hands those over in the metadata of the figure's output, which the execution cache
keeps. Here they become files beside the picture, a source for narrow screens and, for pdf.py, the
name of the lines and letters that print has instead of dots.
"""

from __future__ import annotations

import hashlib
import re
from base64 import b64decode
from pathlib import Path
from typing import Any

from in_parallel import cached, read_page
from jupyter_cache import get_cache

IMAGE = re.compile(r'<img\b[^>]*? src="([^"]*?_images/)([0-9a-f]{64})\.png"[^>]*>')


def pictures(app: Any, docname: str) -> dict[str, dict[str, str]]:
    """What a page's figures have drawn beside their pictures, by the digests of these."""
    cache, page = get_cache(app.config.nb_execution_cache_path), read_page(app.env, docname)
    record = page and cached(cache, page)
    found = {}
    for cell in cache.get_cache_bundle(record.pk).nb.cells if record else ():
        for output in cell.get("outputs", ()):
            if told := output.get("metadata", {}).get("image/png", {}):
                wide = b64decode(output.data["image/png"])
                found[hashlib.sha256(wide).hexdigest()] = told
    return found


def offer(app: Any, docname: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    """Write what a page's figures have drawn for others, and name it beside their pictures."""
    if app.builder.format != "html" or docname not in app.env.found_docs:
        return
    drawn, images = pictures(app, docname), Path(app.outdir) / "_images"
    images.mkdir(exist_ok=True)

    def named(image: re.Match[str]) -> str:
        where, digest = image.groups()
        told, tag, name = drawn.get(digest, {}), image[0], digest[:32]
        if "vector" in told:
            (images / f"{name}.svg").write_text(told["vector"], encoding="utf-8")
            tag = tag.replace("<img", f'<img data-vector="{where}{name}.svg"', 1)
        if "narrow" in told:
            (images / f"{name}-narrow.png").write_bytes(b64decode(told["narrow"]))
            source = f'<source media="(max-width: 600px)" srcset="{where}{name}-narrow.png"/>'
            tag = f"<picture>{source}{tag}</picture>"
        return tag

    context["body"] = IMAGE.sub(named, context["body"])


def setup(app: Any) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("html-page-context", offer)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
