"""Open the built pages in JupyterLab, as notebooks that a reader runs and changes.

``python book/_ext/lab.py`` copies the notebooks of the built book into ``notebooks`` and starts
JupyterLab there, on the first page; what follows it goes to JupyterLab. ``--copy`` copies alone.
Notebooks are copies, and not the pages' sources, because only a built page knows its numbers, and
because a source that is saved from Jupyter would change without anybody having edited it.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import sys
from pathlib import Path

import nbformat
from jupyter_core.paths import jupyter_config_dir
from nbformat.sign import NotebookNotary

ROOT = Path(__file__).resolve().parents[2]
BUILT = ROOT / "_build" / "html" / "_sources" / "notebooks"
FOLDER = ROOT / "notebooks"
RECORD = ".as-built.json"  # digests of the copies' sources, by which a reader's changes are known
FIRST = "00-index.ipynb"
# Names of files have room, and nobody is asked for news.
SETTINGS = {
    "@jupyterlab/filebrowser-extension:browser": {"showLastModifiedColumn": False},
    "@jupyterlab/apputils-extension:notification": {
        "checkForUpdates": False,
        "fetchNews": "false",
    },
}


def copy_pages(built: Path = BUILT, folder: Path = FOLDER) -> list[str]:
    """Copy each page whose text and code its reader has not changed; the names of the others.

    Copies of pages that the book has no more go, too, unless a reader has changed them.

    Copies are signed, for JupyterLab shows no sliders of a notebook that it does not trust. Where
    the book is not built the program ends and says so.
    """
    pages = sorted(built.glob("*.ipynb"))
    if not pages:
        raise SystemExit(f"no notebooks in {built}: make book builds them")
    folder.mkdir(parents=True, exist_ok=True)
    record = folder / RECORD
    digests = json.loads(record.read_text()) if record.exists() else {}
    notary, changed = NotebookNotary(), []
    for page in pages:
        copy = folder / page.name
        present, new = digest(copy) if copy.exists() else None, digest(page)
        if present == new:
            continue  # the reader keeps the outputs of a page that is the same
        if present not in (None, digests.get(page.name)):
            changed.append(page.name)
            continue
        shutil.copy(page, copy)
        digests[page.name] = new
        notary.sign(nbformat.read(copy, as_version=4))
    for name in digests.keys() - {page.name for page in pages}:  # they have gone or moved
        copy = folder / name
        if copy.exists() and digest(copy) == digests[name]:
            copy.unlink()
        del digests[name]
    record.write_text(json.dumps(digests, indent=1))
    return changed


def digest(page: Path) -> str:
    """A digest of what a reader may edit of a page: running a notebook changes only its outputs."""
    cells = nbformat.read(page, as_version=4).cells
    return hashlib.sha256("\0".join(cell.source for cell in cells).encode()).hexdigest()


def write_settings() -> None:
    """JupyterLab's settings for the pages, below those that a reader makes there."""
    folder = Path(jupyter_config_dir()) / "labconfig"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "default_setting_overrides.json").write_text(json.dumps(SETTINGS, indent=1))


def main(options: list[str]) -> None:
    """Command line."""
    if changed := copy_pages():
        print(f"    As you left them, though the book has others now: {', '.join(changed)}.")
        print("    Delete or rename one, and the next make lab brings the book's.", flush=True)
    write_settings()
    if options != ["--copy"]:
        start = [f"--ServerApp.root_dir={FOLDER}", f"--LabApp.default_url=/lab/tree/{FIRST}"]
        # In a container one often is root, which Jupyter wants to be told.
        command = [sys.executable, "-m", "jupyterlab", *start, "--allow-root", *options]
        os.execv(command[0], command)


if __name__ == "__main__":
    main(sys.argv[1:])
