"""Shared by all tests: the book, built beside the other tests, and a browser to read it with."""

import ast
import contextlib
import fcntl
import functools
import importlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from vtbook import plots, widgets
from vtlab.envs.cartpole import CartpoleFamily
from vtlab.experiment import Experiment, Pool
from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.transfer import Settings

os.environ[plots.CHECKED] = "1"  # here and in what tests start
ROOT = Path(__file__).resolve().parents[1]
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FOREIGN = re.compile(r"^(?!file:|data:|blob:|http://127\.0\.0\.1[:/])")
# Set to a folder of built pages to test those instead of building the book.
BUILT = "VTLIB_BOOK_HTML"
FIRST = "gw0"  # of the processes that share the tests; it starts the build
LONGEST = "test_lab.py", "test_trainer_in_browser.py", "test_pages.py"
LOG, STATUS, GROUP = (ROOT / "_build" / f"test-build.{x}" for x in ("log", "status", "group"))
PATIENCE = 180_000  # milliseconds that a page may take on a busy machine
CELL = re.compile(r"```\{code-cell\}[^\n]*\n(?:---\n(.*?)\n---\n)?(.*?)```", re.DOTALL)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """First the method's files, last those that need the book: a file's tests share a process.

    Of these the longest begin, or the last one would run while other processes have no more to do.
    """
    files = {item.path for item in items if needs_book(item)}
    items.sort(key=lambda item: (item.path in files, item.path.name not in LONGEST))


def pytest_collection_finish(session: pytest.Session) -> None:
    """Begin to build the book where a test that was selected needs it."""
    if BUILT in os.environ or session.config.option.collectonly:
        return
    first = os.environ.get("PYTEST_XDIST_WORKER", FIRST) == FIRST
    if first and any(map(needs_book, session.items)):
        start_build()


def needs_book(item: pytest.Item) -> bool:
    """Whether a test looks at the built pages."""
    return "build_faults" in getattr(item, "fixturenames", ())


def start_build() -> None:
    """Begin to build the book; its exit status will be in a file, which all processes can read."""
    LOG.parent.mkdir(exist_ok=True)
    STATUS.unlink(missing_ok=True)
    # Where the browser scripts cannot be fetched, the tests that need them are skipped.
    command = [sys.executable, str(ROOT / "book/_ext/build.py"), "--fresh", "--online"]
    shell = ["sh", "-c", '"$@"; echo $? > "$0"', str(STATUS), *command]
    with LOG.open("w") as out:
        # The build is a process group of its own, so that it can be ended with all its children.
        build = subprocess.Popen(shell, cwd=ROOT, stdout=out, stderr=out, process_group=0)
    build.returncode = 0  # Python would warn of a process for which it has not waited
    GROUP.write_text(str(build.pid))


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Leave no build behind when the tests stop early."""
    if not hasattr(session.config, "workerinput") and GROUP.exists():
        with contextlib.suppress(ProcessLookupError):
            os.killpg(int(GROUP.read_text()), signal.SIGTERM)
        GROUP.unlink()


@pytest.fixture(scope="session")
def tiny() -> Experiment:
    """Three runs of each kind of algorithm, on cartpoles, whose optimum needs no planning."""
    learner = MellowTDSettings(epsilon_steps=100, minibatch=5)
    short = {"iterations": 220, "limit": 230, "check_every": 10, "episodes": 2}
    pool = Pool("tiny-pool", CartpoleFamily(), count=3, settings=learner, **short)
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
def cells_of():
    """The names of a page after its cells were run, and its figures by theirs.

    A moving figure is a pair of its axes and its picture. Numbers for the text go nowhere.
    """
    return functools.cache(run_cells)


def run_cells(name: str) -> dict:
    """Run the code cells of a page, which ask for little of the book's tools."""
    with pytest.MonkeyPatch.context() as patch:
        # only for as long as they run: other tests need the package itself
        patch.setitem(sys.modules, "myst_nb", SimpleNamespace(glue=lambda *_, **__: None))
        patch.setattr("vtbook.page.display", lambda *_, **__: None)
        patch.setattr(widgets, "still_sliders", lambda axes, picture, *_: (axes, picture))
        names: dict = {}
        page = (ROOT / "book" / f"{name}.md").read_text(encoding="utf-8")
        cells = CELL.findall(page)
        assert cells, f"{name} has no code cell that a test can find"
        for head, source in cells:
            code = ast.parse(re.sub(r"^:.*\n", "", source, flags=re.MULTILINE))
            figure = re.search(r"^    name: (\S+)$", head, re.MULTILINE)
            shown = code.body.pop() if figure else None
            exec(compile(code, name, "exec"), names)
            if isinstance(shown, ast.Expr):
                names[figure[1]] = eval(compile(ast.Expression(shown.value), name, "eval"), names)
        return names


@pytest.fixture
def extension(monkeypatch):
    """Import a module of book/_ext, which is no package, for one test."""
    monkeypatch.syspath_prepend(str(ROOT / "book" / "_ext"))
    return importlib.import_module


@pytest.fixture(scope="session")
def build_faults() -> list[str]:
    """What the build of the book complained about, one line each; empty for a clean build."""
    if BUILT in os.environ:
        return []
    while not (STATUS.exists() and (status := STATUS.read_text().strip())):
        time.sleep(0.5)
    if status == "0":
        return []
    lines = re.sub(r"\x1b\[[0-9;]*m", "", LOG.read_text()).splitlines()  # without colours
    return [x for x in lines if re.search(r"\b(WARNING|ERROR|Error):", x)] or lines[-30:]


@pytest.fixture(scope="session")
def book(build_faults: list[str]) -> Iterator[Path]:
    """Folder of the built pages; the tests of a book that did not build are skipped, but one."""
    if build_faults:
        pytest.skip("the book does not build cleanly: see test_the_book_builds")
    folder = Path(os.environ.get(BUILT, ROOT / "_build" / "html")).resolve()
    with (folder.parent / "book.lock").open("a") as lock:
        fcntl.flock(lock, fcntl.LOCK_SH)  # a build that begins meanwhile waits
        yield folder


@pytest.fixture(scope="session")
def vendored(book):
    """Skip what needs the browser scripts where the build could not fetch them and has said so."""
    if not (book / "_static" / "vendor" / "fetched").exists():
        pytest.skip("browser scripts could not be fetched: pages load them from public servers")


@pytest.fixture(scope="session")
def browser():
    """A headless Chromium; tests that need one are skipped where none is installed."""
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        pytest.skip(f"no browser found (looked for {', '.join(BROWSERS)}): apt install chromium")
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=path)
        yield chromium
        chromium.close()


@pytest.fixture(scope="session")
def watched(browser):
    """Open a page; ``page.foreign`` are its requests off this machine, ``page.faults`` errors."""

    @contextlib.contextmanager
    def opened():
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.set_default_timeout(PATIENCE)
        page.foreign, page.faults = [], []

        def refuse(route):
            page.foreign.append(route.request.url)
            route.abort()

        page.context.route(FOREIGN, refuse)
        page.on("pageerror", lambda error: page.faults.append(str(error)))
        yield page
        page.close()

    return opened


@pytest.fixture
def page(watched):
    with watched() as page:
        yield page


@pytest.fixture
def visit(book, page):
    """Open a page of the book from disk."""

    def opened(name):
        page.goto(f"{book.as_uri()}/{name}", wait_until="load")
        page.wait_for_timeout(300)

    return opened
