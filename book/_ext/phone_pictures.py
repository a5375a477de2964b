"""Sphinx extension: a telephone loads the picture that a figure has drawn for its width.

`vtbook.plots` hands that picture over in the metadata of the figure's output, which the
execution cache keeps. Here it becomes a file beside the other, and a source for narrow screens.
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


def pictures(app: Any, docname: str) -> dict[str, bytes]:
    """A page's pictures for telephones, by the digest of those beside them."""
    cache, page = get_cache(app.config.nb_execution_cache_path), read_page(app.env, docname)
    record = page and cached(cache, page)
    found = {}
    for cell in cache.get_cache_bundle(record.pk).nb.cells if record else ():
        for output in cell.get("outputs", ()):
            told = output.get("metadata", {}).get("image/png", {})
            if "narrow" in told:
                wide = b64decode(output.data["image/png"])
                found[hashlib.sha256(wide).hexdigest()] = b64decode(told["narrow"])
    return found


def offer(app: Any, docname: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    """Write a page's pictures for telephones and name them beside the others."""
    if app.builder.format != "html" or docname not in app.env.found_docs:
        return
    narrow, images = pictures(app, docname), Path(app.outdir) / "_images"
    images.mkdir(exist_ok=True)

    def both(image: re.Match[str]) -> str:
        where, digest = image.groups()
        if digest not in narrow:
            return image[0]
        name = f"{digest[:32]}-narrow.png"
        (images / name).write_bytes(narrow[digest])
        source = f'<source media="(max-width: 600px)" srcset="{where}{name}"/>'
        return f"<picture>{source}{image[0]}</picture>"

    context["body"] = IMAGE.sub(both, context["body"])


def setup(app: Any) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("html-page-context", offer)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
