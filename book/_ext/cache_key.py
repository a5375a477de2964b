"""Sphinx extension: a page runs again whenever something that its figures depend on has changed.

jupyter-cache recognises a page by its code cells alone. Here the cache lives in a folder named by
a hash of everything else a page reads: the libraries' sources, the pinned versions, the stored
runs, the published curves and the panel that pages hold a copy of. Files of other kinds, which an
editor or a compiler leaves there, change nothing.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
READ = {".py", ".cpp", ".h", ".wasm", ".js", ".css", ".html", ".txt", ".csv", ".npz", ".json"}
HIDDEN = re.compile(r"(^|/)(\.[^./]|__pycache__)")


def dependencies(root: Path) -> Iterator[tuple[str, Path]]:
    """Files that decide a page's outputs beside its own cells, with their names from the root."""
    results = Path(os.environ.get("VTLIB_RESULTS", root / "book" / "results"))
    static = root / "book" / "_static"
    kinds = "trainer", "stage", "player", "race", "walks", "corridor", "scorecard"
    panels = (path for kind in kinds for path in static.glob(f"{kind}*"))
    # the guide's results are always the book's
    names = "vtlib", "book/vtlab", "book/vtbook", "book/published", "book/results/guide"
    code = (path for name in names for path in (root / name).rglob("*"))
    for path in sorted({root / "requirements.txt", *code, *results.rglob("*"), *panels}):
        name = os.path.relpath(path, root)
        if path.suffix in READ and not HIDDEN.search(name):
            yield name, path


def cache_key(root: Path = ROOT) -> str:
    """Sixteen hexadecimal digits naming the state of the files that the pages depend on."""
    digest = hashlib.sha256()
    for name, path in dependencies(root):
        content = path.read_bytes()
        digest.update(f"{name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()[:16]


def choose_cache(app: Any, config: Any) -> None:
    """Point myst-nb at this state's folder; pages are read anew because the setting changed."""
    caches = Path(app.outdir).parent / ".jupyter_cache"
    config.nb_execution_cache_path = str(caches / cache_key())


def remove_others(app: Any, error: Exception | None) -> None:
    """Remove the caches of other states once a book of this state is there."""
    if error is None:
        ours = Path(app.config.nb_execution_cache_path)
        for folder in ours.parent.iterdir():
            if folder != ours:
                shutil.rmtree(folder, ignore_errors=True)


def setup(app: Any) -> dict[str, Any]:
    """Register with Sphinx, early enough for myst-nb to see the setting."""
    app.connect("config-inited", choose_cache, priority=100)
    app.connect("build-finished", remove_others)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
