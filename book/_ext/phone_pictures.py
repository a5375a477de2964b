"""Sphinx extension: a telephone loads the picture that a figure has drawn for its width.

`vtbook.plots` hands that picture over in the metadata of the figure's output, which the notebook
keeps. Here it becomes a file beside the other, and a source for narrow screens.
"""

from __future__ import annotations

import hashlib
import re
from base64 import b64decode
from pathlib import Path
from typing import Any

import nbformat

IMAGE = re.compile(r'<img\b[^>]*? src="([^"]*?_images/)([0-9a-f]{64})\.png"[^>]*>')


def pictures(path: Path) -> dict[str, bytes]:
    """The pictures for telephones in an executed notebook, by the digest of those for pages."""
    if not path.exists():
        return {}
    cells = nbformat.read(path, as_version=4).cells
    outputs = (one for cell in cells for one in cell.get("outputs", ()))
    return {
        hashlib.sha256(b64decode(one.data["image/png"])).hexdigest(): b64decode(
            one.metadata["image/png"]["narrow"]
        )
        for one in outputs
        if "narrow" in one.get("metadata", {}).get("image/png", {})
    }


def offer(app: Any, docname: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    """Write a page's pictures for telephones and name them beside the others."""
    if app.builder.format != "html" or "body" not in context:
        return
    folder = Path(app.env.mystnb_config.output_folder)
    narrow, images = pictures(folder / f"{docname}.ipynb"), Path(app.outdir) / "_images"
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
