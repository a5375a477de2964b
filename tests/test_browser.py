"""The built book in a browser: no third party, typeset, movable, readable on any screen."""

import importlib.resources
import itertools
import re
from pathlib import Path

import pytest

from vtbook.experiments.cartpole import CARTPOLE
from vtbook.experiments.grids import POSTERIORS, PSIS, slider_lambdas
from vtbook.experiments.maze import MAIN, MAZE_LAMBDAS, MAZE_POSTERIORS, MAZE_PSIS, MAZE_TARGETS
from vtbook.experiments.mountain_car import CAR, CAR_LAMBDAS
from vtbook.experiments.protocols import transfer_settings
from vtbook.experiments.rooms import ROOMS_EXPLORATION, ROOMS_LAMBDAS

SOURCES = Path(__file__).resolve().parents[1] / "book"


@pytest.fixture(scope="module")
def vendored(book):
    """Skip what needs the browser scripts where the build could not fetch them and has said so."""
    if not (book / "_static" / "vendor" / "fetched").exists():
        pytest.skip("browser scripts could not be fetched: pages load them from public servers")


@pytest.fixture(scope="module", params=sorted(path.stem for path in SOURCES.glob("*.md")))
def name(request):
    return request.param


@pytest.fixture(scope="module")
def opened(vendored, book, watched, name):
    """That page, opened once from disk for all that is asked of it, and typeset."""
    with watched() as page:
        page.goto(f"{book.as_uri()}/book/{name}.html", wait_until="load")
        page.wait_for_function(
            "[...document.querySelectorAll('span.math, div.math')]"
            ".every(each => each.querySelector('mjx-container'))"
        )
        yield page


@pytest.fixture
def visits(book, address, page):
    """Open a page from the web server and from disk, yielding its address each time."""

    def visited(name):
        for folder in (address, book.as_uri()):
            page.goto(f"{folder}/book/{name}.html", wait_until="load")
            page.wait_for_timeout(300)
            yield page.url

    return visited


def handles_of(page):
    """The sliders of a page, once they are there and have their names."""
    page.wait_for_selector(".widget-slider .noUi-handle[aria-label]", state="attached")
    return page.locator(".widget-slider .noUi-handle").all()


THEME = "theme => { document.documentElement.dataset.theme = theme }"
ANOTHER_PICTURE = """([panel, shown]) => {
  const seen = [...panel.querySelectorAll('img')].filter(one => one.offsetParent);
  return seen.length === 1 && !shown.includes(seen[0].alt) && seen[0].alt;
}"""


def test_a_page_asks_no_third_party_is_typeset_and_its_figures_move(opened, name):
    source = (SOURCES / f"{name}.md").read_text(encoding="utf-8")
    movable = len(re.findall(r"^(?:widgets\.)?(?:still|setting)_sliders\(", source, re.MULTILINE))
    assert opened.locator("mjx-merror").count() == 0
    if movable:
        handles_of(opened)
    panels = opened.locator(".widget-subarea:has(.noUi-handle)").all()
    assert len(panels) == movable
    for panel in panels:
        for handle in panel.locator(".noUi-handle").all():
            assert handle.get_attribute("aria-label") not in (None, "", "null")
            shown, told = [], set()
            # a slider of the mazes has two values
            for key in ("Home", "End", "ArrowLeft")[: 2 if name == "mazes" else 3]:
                handle.press(key)
                found = opened.wait_for_function(
                    ANOTHER_PICTURE, arg=[panel.element_handle(), shown]
                )
                shown.append(found.json_value())
                told.add(handle.get_attribute("aria-valuetext"))
            assert len(told) == len(shown)
    assert not opened.foreign
    assert not opened.faults


def test_search_finds_a_word_of_the_text(visits, page):
    word, name = "horseshoe", "method"
    for _ in visits(name):
        assert word not in " ".join(page.locator("h1, h2, h3").all_inner_texts()).lower()
        page.locator(".search-button-field:visible, .search-button:visible").first.click()
        box = page.locator("input[type=search]:visible").first
        box.fill(word)
        box.press("Enter")
        page.wait_for_url("**/search.html*")
        page.wait_for_selector(f"#search-results li a[href*='{name}.html']")
        assert not page.faults
        assert not page.foreign


# Tables and figures that end beyond their column, unless a box around them scrolls (for a figure on
# a telephone only), and text that its box cuts off.
HIDDEN = """() => {
  const column = document.querySelector('.bd-article'), said = one => one.outerHTML.slice(0, 100);
  const cuts = overflow => ['hidden', 'clip'].includes(overflow);
  const beyond = one => {
    const mayScroll = innerWidth <= 600 || !one.matches('figure, img');
    for (let box = one.parentElement; box !== column.parentElement; box = box.parentElement) {
      const { overflowX } = getComputedStyle(box);
      if (mayScroll && ['auto', 'scroll'].includes(overflowX)) one = box;
      const [end, most] = [one, box].map(each => each.getBoundingClientRect().right);
      if ((box === column || cuts(overflowX)) && end > most + 1) return true;
    }
  };
  const clipped = one => {
    const { overflowX, overflowY } = getComputedStyle(one);
    return one.innerText?.trim() && !one.closest('.math')  // which holds a copy to be spoken
      && (cuts(overflowX) && one.scrollWidth > one.clientWidth + 1
        || cuts(overflowY) && one.scrollHeight > one.clientHeight + 1);
  };
  const shown = what => [...column.querySelectorAll(what)].filter(one => one.checkVisibility());
  return [
    ...shown('table, figure, img').filter(beyond).map(one => 'beyond: ' + said(one)),
    ...shown('*').filter(clipped).map(one => 'clipped: ' + said(one)),
  ];
}"""


def test_nothing_is_wider_than_the_page(opened):
    for theme, width in itertools.product(("light", "dark"), (1280, 768, 390)):
        opened.evaluate(THEME, theme)
        opened.set_viewport_size({"width": width, "height": 844})
        opened.wait_for_timeout(100)
        excess = opened.evaluate("document.scrollingElement.scrollWidth - innerWidth")
        assert excess <= 0, f"{excess} px wider than a {theme} screen of {width} px"
        assert opened.evaluate(HIDDEN) == [], f"hidden on a {theme} screen of {width} px"


# Of each environment a page: its experiment, the values of lambda, and the first and the last
# iterations of a slider over them, on a panel of its own.
SETTINGS = {
    "cartpole": (CARTPOLE, slider_lambdas(transfer_settings(CARTPOLE.published, "1-MGVT")), ()),
    "mountain_car": (CAR, CAR_LAMBDAS, (0, 200, 500, 5000)),
    "mazes": (MAZE_TARGETS[MAIN], MAZE_LAMBDAS, (0, 500, 1000, 4000)),
    "rooms_exploration": (ROOMS_EXPLORATION, ROOMS_LAMBDAS, (0, 50, 100, 2000)),
}


def assert_shown(page, setting, panels):
    """One picture is visible in each panel, and one description names the setting."""
    visible = "[...document.querySelectorAll('.widget-subarea img')].filter(i => i.offsetParent)"
    named = "v.filter(i => texts.every(t => i.alt.includes(t))).length === 1"
    test = f"([texts, panels]) => {{ const v = {visible}; return v.length === panels && {named} }}"
    page.wait_for_function(test, arg=[setting, panels])


@pytest.mark.usefixtures("vendored")
@pytest.mark.parametrize("name", SETTINGS)
def test_each_slider_shows_the_picture_of_its_setting(visits, page, name):
    experiment, lambdas, moments = SETTINGS[name]
    psis, posteriors = (MAZE_PSIS, MAZE_POSTERIORS) if name == "mazes" else (PSIS, POSTERIORS)
    values = [[f"lambda = {x:.0e}," for x in lambdas], [f"psi = {x:g}," for x in psis]]
    values.append([f" {x};" for x in posteriors])
    base, panels = transfer_settings(experiment.published, "1-MGVT"), 1 + bool(moments)
    for _ in visits(name):
        *above, first, second, third = handles_of(page)
        assert len(above) == panels - 1
        current = [f"lambda = {base.lambda_:.0e},", f"psi = {base.psi:g},", " 1-MGVT;"]
        assert_shown(page, current, panels)
        for key, moment in zip(("Home", "ArrowRight", "ArrowRight", "End"), moments, strict=False):
            above[0].press(key)
            assert_shown(page, [f"after {moment} iterations"], panels)
        for axis, handle in enumerate((first, second, third)):
            for at, text in enumerate(values[axis]):
                handle.press("ArrowRight" if at else "Home")
                current[axis] = text
                assert_shown(page, current, panels)


def test_a_state_of_the_sliders_can_be_linked(visits, page):
    base = transfer_settings(ROOMS_EXPLORATION.published, "1-MGVT")
    for url in visits("rooms_exploration"):
        *_, power, psi, _ = handles_of(page)
        assert "#" not in page.url
        power.press("End")
        psi.press("Home")
        assert page.url == f"{url}#lambda={len(ROOMS_LAMBDAS) - 1}&psi=0"
        linked = [f"lambda = {ROOMS_LAMBDAS[-1]:.0e},", "psi = 0,", " 1-MGVT;"]
        assert_shown(page, linked, 2)
        page.reload()
        handles_of(page)
        assert_shown(page, linked, 2)
        for wild in ("psi=x&posterior=2&nothing=1", "the-question"):
            page.goto("about:blank")
            page.goto(f"{url}#{wild}")
            handles_of(page)
            usual = [f"lambda = {base.lambda_:.0e},", f"psi = {base.psi:g},"]
            assert_shown(page, [*usual, f" {POSTERIORS[2]};" if "=" in wild else " 1-MGVT;"], 2)


STEP = "Number(document.querySelector('.race input').value)"


def test_the_race_plays_by_itself_pauses_and_is_scrubbed(visits, page):
    for _ in visits("index"):
        counts, button = page.locator(".race .count"), page.locator(".race button")
        button.scroll_into_view_if_needed()
        page.wait_for_function(f"{STEP} > 20 && {STEP} < 5000")
        button.click()
        assert button.inner_text() == "Play"
        held = page.evaluate(STEP)
        page.wait_for_timeout(200)
        assert page.evaluate(STEP) == held
        page.locator(".race input").press("Home")
        assert counts.all_inner_texts() == ["goal reached 0 times"] * 2
        page.keyboard.press("End")
        told = page.locator(".race .squares").get_attribute("aria-label")
        for text in counts.all_inner_texts():
            assert text.removeprefix("goal reached ") in told


def test_the_race_stands_still_at_its_end_for_those_who_want_no_motion(address, page):
    page.emulate_media(reduced_motion="reduce")
    page.goto(f"{address}/book/index.html", wait_until="load")
    page.locator(".race button").scroll_into_view_if_needed()
    page.wait_for_timeout(500)
    assert page.evaluate(STEP) == 5000
    page.locator(".race button").click()
    page.wait_for_function(f"{STEP} > 0 && {STEP} < 5000")


AXE = importlib.resources.files("axe_playwright_python") / "axe.min.js"
FINDINGS = """async ([where, only]) => {
  const found = await axe.run(where, {resultTypes: ["violations"], ...only});
  return found.violations.filter(one => ["serious", "critical"].includes(one.impact))
    .map(one => `${one.id} (${one.nodes.length}): ${one.nodes[0].html.slice(0, 200)}`);
}"""
# colours fade over, and a busy machine takes its time; what is cut short, or hangs, counts as done
FADED = """
() => Promise.race([
  new Promise(done => setTimeout(done, 1000)),
  Promise.all(document.getAnimations()
    .filter(one => one.effect.getComputedTiming().endTime < Infinity)
    .map(one => one.finished.catch(() => null))),
]).then(() => null)
"""


def test_no_serious_barrier_to_reading(opened, name):
    # formulas and coloured code, whose thousands of parts take longest, are alike on all pages
    where = {"include": ["html"], "exclude": ["mjx-container", ".highlight"]}
    where = "html" if name == "method" else where
    opened.set_viewport_size({"width": 1280, "height": 900})
    opened.evaluate(AXE.read_text(encoding="utf-8"))
    for theme, only in (("light", {}), ("dark", {"runOnly": ["color-contrast"]})):
        opened.evaluate(THEME, theme)
        opened.evaluate(FADED)
        assert opened.evaluate(FINDINGS, [where, only]) == [], theme
