"""Build the book: browser scripts, then every page, with each warning an error.

``python book/_ext/build.py`` keeps what is up to date. ``--fresh`` renders every page anew (outputs
of unchanged pages still come from the execution cache), which is what a test has to do: a second
incremental build says nothing about pages that failed in the first. ``--results FOLDER`` draws the
book from runs computed anew, into ``FOLDER/_build/html``.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

from fetch_assets import fetch
from set_up import alone

# Not the script beside Python: in a copied environment that belongs to the one it was copied from.
TOOL = "from jupyter_book.cli.main import main; main()"
ROOT = Path(__file__).resolve().parents[2]


def build(fresh: bool, results: Path | None, online: bool = False) -> int:
    """Run Jupyter Book over the root; returns its exit status, non-zero on any warning."""
    print("--> Browser scripts (MathJax, sliders)", flush=True)
    try:
        fetch()
    except OSError as error:
        print(f"    They cannot be fetched: {error}.")
        print("    Without them pages ask public servers for MathJax and the sliders' script.")
        if not online:
            raise SystemExit(
                "    Go on line and build again, or allow it for this build: make book ONLINE=yes"
            ) from None
    folder = (results or ROOT) / "_build"
    if fresh or (folder / "failed").exists():
        for part in ("html", ".doctrees"):
            shutil.rmtree(folder / part, ignore_errors=True)
    (folder / "failed").touch()
    print("--> Pages", flush=True)
    command = [sys.executable, "-c", TOOL, "build", ".", "-W", "-n", "--keep-going"]
    # one thread: small tensors gain nothing by more, and lose much where cores are busy
    environment = os.environ | {"NO_COLOR": "1", "PYTHONUNBUFFERED": "1", "OMP_NUM_THREADS": "1"}
    environment["VTLIB_CHECK_FIGURES"] = "1"  # one that is cut off fails its page
    if results:
        command += ["--path-output", str(results)]
        environment["VTLIB_RESULTS"] = str(results)
    status = subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode
    if status == 0:
        (folder / "failed").unlink()
    return status


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description="Build the book into _build/html.")
    parser.add_argument("--fresh", action="store_true", help="render every page anew")
    parser.add_argument("--results", type=Path, help="other stored runs than book/results")
    parser.add_argument("--online", action="store_true", help="pages may ask public servers")
    arguments = parser.parse_args()
    results = arguments.results and arguments.results.resolve()
    html = (results or ROOT) / "_build" / "html"
    try:
        with alone(html.parent / "book.lock", "builds or tests the book"):
            status = build(arguments.fresh, results, arguments.online)
    except KeyboardInterrupt:
        print("Interrupted: the same command goes on with the pages that have not run.")
        return 130
    if status:
        print("The book has warnings or failing pages, listed above; tracebacks of cells are under")
        print(f"{html / 'reports'}.")
    else:
        print(f"==> Built. Open {html / 'index.html'} in a browser.")
    return status


if __name__ == "__main__":
    raise SystemExit(main())
