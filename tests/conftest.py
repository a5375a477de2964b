"""Shared by all tests: the book, built beside the other tests, and a browser to read it with."""

from __future__ import annotations

import ast
import contextlib
import functools
import http.server
import importlib
import os
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from vtbook import widgets
from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.envs.cartpole import CartpoleFamily
from vtlib.experiments.experiment import Experiment, Pool
from vtlib.transfer import Settings

ROOT = Path(__file__).resolve().parents[1]
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
BROWSER_ARGUMENTS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--no-first-run",
)
# Set to a folder of built pages to test those instead of building the book.
BUILT = "VTLIB_BOOK_HTML"
BUILD_LIMIT = 1800  # seconds
CELL = re.compile(r"```\{code-cell\} python3\n(?:---\n(.*?)\n---\n)?(.*?)```", re.DOTALL)

_build: list[tuple[subprocess.Popen, Path]] = []


def reads_the_book(item: pytest.Item) -> bool:
    """Whether a test waits for the book to be built."""
    return "build_faults" in getattr(item, "fixturenames", ())


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests of the book come last: it is being built while the others run."""
    items.sort(key=reads_the_book)


def pytest_collection_finish(session: pytest.Session) -> None:
    """Start building as soon as it is known that a test will ask for the book."""
    wanted = any(map(reads_the_book, session.items))
    if wanted and not session.config.option.collectonly and BUILT not in os.environ:
        log = ROOT / "_build" / "test-build.log"
        log.parent.mkdir(exist_ok=True)
        command = [sys.executable, str(ROOT / "book" / "_ext" / "build.py"), "--fresh"]
        command += ["--online"]  # where scripts cannot be fetched the tests of them are skipped
        with log.open("w") as out:
            process = subprocess.Popen(command, cwd=ROOT, stdout=out, stderr=subprocess.STDOUT)
        _build.append((process, log))


def pytest_sessionfinish() -> None:
    """Leave no build behind when the tests stop early."""
    for process, _ in _build:
        if process.poll() is None:
            process.terminate()
            process.wait()


def faults_in(log: str) -> list[str]:
    """Lines of a build's log that name a page and what is wrong with it, without colours."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", log)
    return [line for line in plain.splitlines() if re.search(r"\b(WARNING|ERROR|Error):", line)]


@pytest.fixture(scope="session")
def tiny() -> Experiment:
    """Three runs of each kind of algorithm, on cartpoles, whose optimum needs no planning."""
    learner = MellowTDSettings(epsilon_steps=100, minibatch=5)
    pool = Pool(
        "tiny-pool",
        CartpoleFamily(),
        count=3,
        iterations=220,
        limit=230,
        check_every=10,
        episodes=2,
        settings=learner,
    )
    algorithms = {
        "NT": learner,
        "DDQN": DDQNSettings(epsilon_steps=100, minibatch=5),
        "GVT": Settings("gaussian", minibatch=5, n_samples=2),
        "2-MGVT": Settings(components=2, minibatch=5, n_samples=2),
    }
    return Experiment(
        "tiny", pool, CartpoleFamily(), algorithms, runs=3, sources=2, iterations=220, every=20
    )


@pytest.fixture(scope="session")
def weights(tiny: Experiment) -> np.ndarray:
    """Weights of a pool of cartpoles that nobody has solved."""
    rng = np.random.default_rng(0)
    return 0.1 * rng.standard_normal((50, tiny.family.q().d), dtype=np.float32)


@pytest.fixture(scope="session")
def cells_of() -> Callable[[str], dict[str, Any]]:
    """The names of a page after its cells were run, and its figures by theirs.

    A moving figure is a pair of its axes and its picture. Numbers for the text go nowhere.
    """
    return functools.cache(run_cells)


def run_cells(name: str) -> dict[str, Any]:
    """Run the code cells of a page, which ask for little of the book's tools."""
    with pytest.MonkeyPatch.context() as patch:
        # only for as long as they run: other tests need the package itself
        patch.setitem(sys.modules, "myst_nb", SimpleNamespace(glue=lambda *_, **__: None))
        patch.setattr(widgets, "still_sliders", lambda axes, picture: (axes, picture))
        return _run_cells(name)


def _run_cells(name: str) -> dict[str, Any]:
    names: dict[str, Any] = {}
    for head, source in CELL.findall((ROOT / "book" / f"{name}.md").read_text(encoding="utf-8")):
        code = ast.parse(re.sub(r"^:.*\n", "", source, flags=re.MULTILINE))
        figure = re.search(r"^    name: (\S+)$", head, re.MULTILINE)
        shown = code.body.pop() if figure else None
        exec(compile(code, name, "exec"), names)
        if isinstance(shown, ast.Expr):
            names[figure[1]] = eval(compile(ast.Expression(shown.value), name, "eval"), names)
    return names


@pytest.fixture
def extension(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], ModuleType]:
    """Import a module of book/_ext, which is no package, for one test."""
    monkeypatch.syspath_prepend(str(ROOT / "book" / "_ext"))
    return importlib.import_module


@pytest.fixture(scope="session")
def build_faults() -> list[str]:
    """What the build of the book complained about, one line each; empty for a clean build."""
    if BUILT in os.environ:
        return []
    process, log = _build[0]
    if process.wait(timeout=BUILD_LIMIT) == 0:
        return []
    text = log.read_text()
    return faults_in(text) or text.splitlines()[-30:]


@pytest.fixture(scope="session")
def book(build_faults: list[str]) -> Path:
    """Folder of the built pages; the tests of a book that did not build are skipped, but one."""
    if build_faults:
        pytest.skip("the book does not build cleanly: see test_the_book_builds")
    return Path(os.environ.get(BUILT, ROOT / "_build" / "html")).resolve()


@pytest.fixture(scope="session")
def address(book: Path) -> Iterator[str]:
    """Address of the book on a local web server, without a slash at the end."""

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_: Any) -> None:
            """Requests are not worth a line."""

        def copyfile(self, source: Any, outputfile: Any) -> None:
            # A browser that leaves a page hangs up on what it no longer needs.
            with contextlib.suppress(ConnectionError):
                super().copyfile(source, outputfile)

    handler = functools.partial(Quiet, directory=str(book))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        server.daemon_threads = True
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """A headless Chromium; tests that need one are skipped where none is installed."""
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        pytest.skip(f"no browser found (looked for {', '.join(BROWSERS)}): apt install chromium")
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=path, args=[*BROWSER_ARGUMENTS])
        yield chromium
        chromium.close()


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    """A fresh page: ``page.foreign`` lists requests off this machine, ``page.faults`` errors."""
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    page = context.new_page()
    page.foreign, page.faults = [], []

    def inspect(route: Any) -> None:
        url = route.request.url
        if re.match(r"(file:|data:|blob:|http://127\.0\.0\.1[:/])", url):
            route.continue_()
        else:
            page.foreign.append(url)
            route.abort()

    context.route("**/*", inspect)
    page.on("pageerror", lambda error: page.faults.append(str(error)))
    yield page
    context.close()
