"""The built book in a browser: no third party, typeset, movable, readable on any screen."""

from __future__ import annotations

import importlib.resources
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from vtbook.experiments.cartpole import CARTPOLE
from vtbook.experiments.grids import POSTERIORS, PSIS, slider_lambdas
from vtbook.experiments.maze import MAZE_LAMBDAS, MAZE_POSTERIORS, MAZE_PSIS
from vtbook.experiments.maze import PUBLISHED_MGVT as MAZE_MGVT
from vtbook.experiments.mountain_car import CAR, CAR_LAMBDAS
from vtbook.experiments.rooms import PUBLISHED_MGVT, ROOMS_LAMBDAS
from vtlib.transfer import Settings


def names(book: Path) -> list[str]:
    """Pages with a source in book/, below the folder of the built ones."""
    return sorted(f"book/{path.name}" for path in (book / "book").glob("*.html"))


def open_everywhere(page, book: Path, address: str, name: str) -> Iterator[str]:
    """Open a page from the web server and from disk, yielding its address each time."""
    for url in (f"{address}/{name}", (book / name).as_uri()):
        page.goto(url, wait_until="load")
        page.wait_for_timeout(300)
        yield url


@pytest.fixture(scope="module")
def vendored(book: Path) -> None:
    """Skip what needs the browser scripts where the build could not fetch them and has said so."""
    if not (book / "_static" / "vendor" / "fetched").exists():
        pytest.skip("browser scripts could not be fetched: pages load them from public servers")


@pytest.mark.usefixtures("vendored")
def test_no_third_party_and_no_script_errors(book: Path, address: str, page) -> None:
    for name in names(book):
        for url in open_everywhere(page, book, address, name):
            assert not page.foreign, f"{url} asks {page.foreign}"
            assert not page.faults, f"{url}: {page.faults}"


@pytest.mark.usefixtures("vendored")
def test_equations_are_typeset(book: Path, address: str, page) -> None:
    for name in names(book):
        for url in open_everywhere(page, book, address, name):
            page.wait_for_function(
                "[...document.querySelectorAll('span.math, div.math')]"
                ".every(each => each.querySelector('mjx-container'))"
            )
            assert page.locator("mjx-merror").count() == 0, url


def test_search_finds_a_page(book: Path, address: str, page) -> None:
    for _ in open_everywhere(page, book, address, "book/index.html"):
        page.locator(".search-button-field:visible, .search-button:visible").first.click()
        box = page.locator("input[type=search]:visible").first
        box.fill("posterior")
        box.press("Enter")
        page.wait_for_url("**/search.html*")
        page.wait_for_selector("#search-results li a")
        assert page.locator("#search-results li a").count() >= 1
        assert not page.faults


# A word of the text that stands in no heading, and the page that has it.
@pytest.mark.parametrize(("word", "name"), [("horseshoe", "method"), ("LAPACK", "reproducing")])
def test_search_finds_a_word_of_the_text(book: Path, address: str, page, word, name) -> None:
    for folder in (address, book.as_uri()):
        page.goto(f"{folder}/book/{name}.html", wait_until="load")
        titles = " ".join(page.locator("h1, h2, h3").all_inner_texts())
        assert word.lower() not in titles.lower()
        page.goto(f"{folder}/search.html?q={word}", wait_until="load")
        page.wait_for_selector(f"#search-results li a[href*='{name}.html']")
        assert not page.faults
        assert not page.foreign


def test_dark_mode_toggles_and_is_remembered(book: Path, address: str, page) -> None:
    def background() -> str:
        return page.evaluate("getComputedStyle(document.body).backgroundColor")

    page.goto(f"{address}/book/index.html")
    seen = {}
    for _ in range(3):
        page.locator(".theme-switch-button:visible").first.click()
        seen[page.evaluate("document.documentElement.dataset.theme")] = background()
    assert set(seen) == {"light", "dark"}
    assert seen["light"] != seen["dark"]
    while page.evaluate("document.documentElement.dataset.mode") != "dark":
        page.locator(".theme-switch-button:visible").first.click()
    page.reload()
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"


@pytest.mark.parametrize("width", [390, 768, 1280])
def test_nothing_is_wider_than_the_page(book: Path, address: str, page, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 844})
    for name in names(book):
        page.goto(f"{address}/{name}", wait_until="load")
        page.wait_for_timeout(500)
        excess = page.evaluate("document.scrollingElement.scrollWidth - innerWidth")
        assert excess <= 0, f"{name} is {excess} px wider than a screen of {width} px"


@pytest.mark.usefixtures("vendored")
def test_sliders_are_named_and_move_with_the_keyboard(book: Path, address: str, page) -> None:
    for name in names(book):
        if "application/vnd.jupyter.widget-view+json" not in (book / name).read_text("utf-8"):
            continue
        for url in open_everywhere(page, book, address, name):
            page.wait_for_selector(".widget-slider .noUi-handle[aria-label]", state="attached")
            for handle in page.locator(".widget-slider .noUi-handle").all():
                assert handle.get_attribute("aria-label") not in (None, "", "null"), url
                before = handle.get_attribute("aria-valuetext")
                low = handle.get_attribute("aria-valuenow") == handle.get_attribute("aria-valuemin")
                handle.focus()
                page.keyboard.press("ArrowRight" if low else "ArrowLeft")
                page.wait_for_function(
                    "([e, old]) => e.getAttribute('aria-valuetext') !== old",
                    arg=[handle.element_handle(), before],
                )


VISIBLE = "[...document.querySelectorAll('.widget-subarea img')].filter(i => i.offsetParent)"
ALTS = "f => [...f.querySelectorAll('img')].filter(i => i.offsetParent).map(i => i.alt)"
ONE_OTHER = (
    f"([f, old]) => {{ const a = ({ALTS})(f); return a.length === 1 && !old.includes(a[0]) }}"
)


def panels_of(base: Settings, lambdas: Sequence[float], panels: int = 1, psis=PSIS):
    return base, lambdas, panels, psis


CART = CARTPOLE.published.transfer_settings("1-MGVT")
ROOMS = panels_of(PUBLISHED_MGVT, ROOMS_LAMBDAS)
# The setting that each page's sliders start at, the values of lambda, its slider panels, and the
# values of psi.
SETTINGS = {
    "cartpole": panels_of(CART, slider_lambdas(CART), 1),
    "mountain_car": panels_of(CAR.published.transfer_settings("1-MGVT"), CAR_LAMBDAS, 2),
    "mazes": panels_of(MAZE_MGVT, MAZE_LAMBDAS, 2, MAZE_PSIS),
    "rooms_evaluation": ROOMS,
    "rooms_distribution_change": ROOMS,
    "rooms_exploration": panels_of(PUBLISHED_MGVT, ROOMS_LAMBDAS, 2),
    "rooms_likelihood": ROOMS,
    "rooms_number_of_sources": ROOMS,
}


@pytest.mark.usefixtures("vendored")
@pytest.mark.parametrize("name", SETTINGS)
def test_each_slider_shows_the_picture_of_its_setting(
    book: Path, address: str, page, name: str
) -> None:
    base, lambdas, panels, psis = SETTINGS[name]
    values = [[f"lambda = {x:.0e}," for x in lambdas], [f"psi = {x:g}," for x in psis]]
    values.append([f" {x};" for x in (MAZE_POSTERIORS if name == "mazes" else POSTERIORS)])
    for _ in open_everywhere(page, book, address, f"book/{name}.html"):
        page.wait_for_selector(".widget-slider .noUi-handle[aria-label]", state="attached")
        handles = page.locator(".widget-slider .noUi-handle").all()
        counted = name == "rooms_number_of_sources"
        assert len(handles) == len(values) + panels - 1 + counted
        current = [f"lambda = {base.lambda_:.0e},", f"psi = {base.psi:g},", " 1-MGVT;"]
        assert_shown(page, current, panels)
        for axis, handle in enumerate(handles[panels - 1 :][:3]):
            handle.focus()
            page.keyboard.press("Home")
            for at, text in enumerate(values[axis]):
                if at:
                    page.keyboard.press("ArrowRight")
                current[axis] = text
                assert_shown(page, current, panels)


MOMENTS = {
    "rooms_exploration": ((0, 50, 100), 2000, 2),
    "mountain_car": ((0, 200, 500), 5000, 2),
    "mazes": ((0, 500, 1000), 4000, 2),
}


@pytest.mark.usefixtures("vendored")
@pytest.mark.parametrize("name", MOMENTS)
def test_the_slider_over_iterations_shows_each_moment(
    book: Path, address: str, page, name: str
) -> None:
    first, last, panels = MOMENTS[name]
    for _ in open_everywhere(page, book, address, f"book/{name}.html"):
        handle = page.locator(".widget-slider .noUi-handle[aria-label]").first
        handle.wait_for(state="attached")
        handle.focus()
        page.keyboard.press("Home")
        for iteration in first:
            assert_shown(page, [f"after {iteration} iterations"], panels)
            page.keyboard.press("ArrowRight")
        page.keyboard.press("End")
        assert_shown(page, [f"after {last} iterations"], panels)


@pytest.mark.usefixtures("vendored")
@pytest.mark.parametrize(("name", "count"), [("background", 4), ("method", 6)])
def test_the_formulas_move(book: Path, address: str, page, name: str, count: int) -> None:
    for url in open_everywhere(page, book, address, f"book/{name}.html"):
        page.wait_for_selector(".widget-slider .noUi-handle[aria-label]", state="attached")
        figures = page.locator("figure:has(.noUi-handle)").all()
        assert len(figures) == count, url
        for figure in figures:
            for handle in figure.locator(".noUi-handle").all():
                handle.focus()
                shown = []
                for key in ("Home", "End", "ArrowLeft"):
                    page.keyboard.press(key)
                    page.wait_for_function(ONE_OTHER, arg=[figure.element_handle(), shown])
                    shown.append(page.evaluate(ALTS, figure.element_handle())[0])


def assert_shown(page, setting: list[str], panels: int) -> None:
    """One picture is visible in each panel, and one description names the setting."""
    named = "v.filter(i => texts.every(t => i.alt.includes(t))).length === 1"
    test = f"([texts, panels]) => {{ const v = {VISIBLE}; return v.length === panels && {named} }}"
    page.wait_for_function(test, arg=[setting, panels])


STEP = "Number(document.querySelector('.race input').value)"


def test_the_race_plays_by_itself_pauses_and_is_scrubbed(book: Path, address: str, page) -> None:
    for _ in open_everywhere(page, book, address, "book/index.html"):
        counts, button = page.locator(".race .count"), page.locator(".race button")
        button.scroll_into_view_if_needed()
        page.wait_for_function(f"{STEP} > 20 && {STEP} < 5000")
        button.click()
        assert button.inner_text() == "Play"
        held = page.evaluate(STEP)
        page.wait_for_timeout(200)
        assert page.evaluate(STEP) == held
        page.locator(".race input").focus()
        page.keyboard.press("Home")
        assert counts.all_inner_texts() == ["goal reached 0 times"] * 2
        page.keyboard.press("End")
        told = page.locator(".race .squares").get_attribute("aria-label")
        for text in counts.all_inner_texts():
            assert text.removeprefix("goal reached ") in told


def test_the_race_stands_still_at_its_end_for_those_who_want_no_motion(
    book: Path, address: str, page
) -> None:
    page.emulate_media(reduced_motion="reduce")
    page.goto(f"{address}/book/index.html", wait_until="load")
    page.locator(".race button").scroll_into_view_if_needed()
    page.wait_for_timeout(500)
    assert page.evaluate(STEP) == 5000
    page.locator(".race button").click()
    page.wait_for_function(f"{STEP} > 0 && {STEP} < 5000")


AXE = importlib.resources.files("axe_playwright_python") / "axe.min.js"
FINDINGS = """async only => {
  const found = await axe.run(document, {resultTypes: ["violations"], ...only});
  return found.violations.filter(one => ["serious", "critical"].includes(one.impact))
    .map(one => `${one.id} (${one.nodes.length}): ${one.nodes[0].html.slice(0, 200)}`);
}"""


# colours fade over, and a busy machine takes its time; one that is cut short counts as done
FADED = """
() => Promise.all(document.getAnimations()
    .filter(one => one.effect.getComputedTiming().endTime < Infinity)
    .map(one => one.finished.catch(() => null))).then(() => null)
"""


@pytest.mark.usefixtures("vendored")
def test_no_serious_barrier_to_reading_in_light_and_dark(book: Path, address: str, page) -> None:
    found = []
    for name in names(book):
        page.goto(f"{address}/{name}", wait_until="load")
        page.evaluate("window.MathJax?.startup?.promise?.then(() => null)")
        page.evaluate(AXE.read_text(encoding="utf-8"))
        for theme, only in (("light", {}), ("dark", {"runOnly": ["color-contrast"]})):
            page.evaluate("theme => document.documentElement.dataset.theme = theme", theme)
            page.evaluate(FADED)
            found += [f"{name}, {theme}: {one}" for one in page.evaluate(FINDINGS, only)]
    assert not found, "\n".join(found)
