"""Sphinx extension: load the vendored browser scripts, or the public ones where there are none."""

from __future__ import annotations

from typing import Any

from fetch_assets import present
from sphinx.util import logging

LOGGER = logging.getLogger(__name__)
MATHJAX = "vendor/mathjax/tex-svg.js"
WIDGETS = "vendor/html-manager/embed.js"


def use_local_assets(app: Any, config: Any) -> None:
    """Replace the public addresses that Sphinx and myst-nb would write into the pages."""
    if present():
        config.mathjax_path = MATHJAX
        config.nb_ipywidgets_js = {WIDGETS: {}}
    else:
        LOGGER.info(
            "browser scripts are not vendored: these pages load MathJax and the sliders' script "
            "from public servers (cdn.jsdelivr.net, cdnjs.cloudflare.com)"
        )


def setup(app: Any) -> dict[str, Any]:
    """Register with Sphinx, early enough for mathjax and myst-nb to see the settings."""
    app.connect("config-inited", use_local_assets, priority=100)
    # book.js hands slider labels to MathJax, so it has to run before the sliders' script.
    return {"parallel_read_safe": True, "parallel_write_safe": True}
