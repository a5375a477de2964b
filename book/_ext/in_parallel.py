"""Sphinx extension: pages run side by side, one on each processor.

Sphinx would run one page after the other. This extension runs the pages that are not in the
execution cache before Sphinx reads them. Sphinx runs a page that fails again, and reports why. A
Python warning in a cell is one of the build.
"""

from __future__ import annotations

import asyncio
import math
import os
import tempfile
import time
from pathlib import Path
from typing import Any

from jupyter_cache import get_cache
from jupyter_cache.base import CacheBundleIn
from kernels import forked
from myst_nb.core.read import create_nb_reader
from nbclient import NotebookClient
from nbclient.exceptions import CellControlSignal
from nbformat import NotebookNode
from sphinx.util import logging

LOGGER = logging.getLogger(__name__)
# The cache knows cells by their metadata, so none may be added. Kernels report errors alone.
AS_READ: dict[str, Any] = {"record_timing": False, "extra_arguments": ["--log-level=ERROR"]}
AT_MOST = 4  # pages at a time: each has the stored runs that it shows in memory


async def run(path: Path, page: NotebookNode, room: asyncio.Semaphore, **how: Any) -> float:
    """Run a page's cells; the seconds that they took, or infinity if one failed.

    They run in an empty folder, for a reader's notebook is not beside the book's files either.
    """
    async with room:
        begin = time.monotonic()
        try:
            with tempfile.TemporaryDirectory() as folder:
                where = {"metadata": {"path": folder}}
                await NotebookClient(page, resources=where, **AS_READ, **how).async_execute()
        except (CellControlSignal, RuntimeError):  # RuntimeError: the kernel died
            return math.inf
        seconds = time.monotonic() - begin
        LOGGER.info(f"ran {path.stem} in {seconds:.0f} s")
        return seconds


async def run_all(pages: dict[Path, NotebookNode], timeout: int) -> list[float]:
    """Run pages side by side, in their order; the seconds that each took."""
    if not pages:
        return []
    room = asyncio.Semaphore(min(os.cpu_count() or 1, AT_MOST))
    with forked() as manager:
        how = {"timeout": timeout, "kernel_manager_class": manager}
        return await asyncio.gather(*(run(*item, room, **how) for item in pages.items()))


def read_page(env: Any, docname: str) -> NotebookNode | None:
    """A page as the notebook that Sphinx reads, None for one without cells."""
    path = str(env.doc2path(docname))
    text = Path(path).read_text(encoding="utf-8")
    reader = create_nb_reader(path, env.myst_config, env.mystnb_config, text)
    return reader and reader.read(text)


def executed(app: Any, docname: str) -> NotebookNode | None:
    """A page with the outputs that the execution cache has of it; None where it has none."""
    page, cache = read_page(app.env, docname), get_cache(app.config.nb_execution_cache_path)
    try:
        return page and cache.merge_match_into_notebook(page)[1]
    except KeyError:
        return None


def warnings_of(page: NotebookNode) -> list[str]:
    """What the cells of a page that has run were warned of; the book shows none of it."""
    outputs = [output for cell in page.cells for output in cell.get("outputs", ())]
    return [x.text for x in outputs if x.get("name") == "stderr" and "Warning" in x.text]


def run_pages(app: Any, env: Any, docnames: list[str]) -> None:
    """Fill the execution cache with the pages that are to be read and are not in it."""
    cache = get_cache(app.config.nb_execution_cache_path)
    missing = [name for name in docnames if executed(app, name) is None]
    pages = {Path(env.doc2path(name)): read_page(env, name) for name in missing}
    pages = {path: page for path, page in pages.items() if page}
    durations = asyncio.run(run_all(pages, env.mystnb_config.execution_timeout))
    for (path, page), seconds in zip(pages.items(), durations, strict=True):
        if seconds < math.inf:
            bundle = CacheBundleIn(page, str(path), data={"execution_seconds": seconds})
            cache.cache_notebook_bundle(bundle, check_validity=False, overwrite=True)
    for name in docnames:
        page = executed(app, name)
        for text in warnings_of(page) if page else ():
            LOGGER.warning(text, location=name)


def setup(app: Any) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("env-before-read-docs", run_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
