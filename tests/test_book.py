"""The built book: complete, self-contained, readable on a desk and on a telephone."""

from __future__ import annotations

import importlib.resources
import json
import re
import subprocess
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from urllib.parse import unquote, urldefrag, urlsplit

import pytest
from bs4 import BeautifulSoup

from vtlib.experiments.cartpole import MGVT as CARTPOLE_MGVT
from vtlib.experiments.experiment import COMPONENTS, PSIS, slider_lambdas
from vtlib.experiments.maze import MAZE_COMPONENTS, MAZE_LAMBDAS, MAZE_MGVT, MAZE_PSIS
from vtlib.experiments.mountain_car import CAR_LAMBDAS
from vtlib.experiments.mountain_car import MGVT as CAR_MGVT
from vtlib.experiments.rooms import MGVT
from vtlib.transfer import Settings

ROOT = Path(__file__).resolve().parents[1]
SYSTEM_PAGES = {"genindex.html", "search.html", "index.html"}


def pages(book: Path) -> list[Path]:
    """Pages written for readers, and those that Sphinx adds."""
    found = [path for path in book.rglob("*.html") if "_static" not in path.parts]
    assert found, f"no pages under {book}"
    return sorted(found)


def written_pages(book: Path) -> list[Path]:
    """Pages that have a source in book/."""
    return [path for path in pages(book) if path.parent != book]


@cache
def soup(path: Path) -> BeautifulSoup:
    """A parsed page."""
    return BeautifulSoup(path.read_text(encoding="utf-8"), "html.parser")


def references(document: BeautifulSoup) -> Iterator[str]:
    """Every address that a page links to or loads."""
    for tag in document.find_all(True):
        for attribute in ("href", "src", "data"):
            if isinstance(tag.get(attribute), str):
                yield tag[attribute]


@cache
def identifiers(path: Path) -> set[str]:
    """Every target that a fragment can name on a page."""
    return {tag["id"] for tag in soup(path).find_all(id=True)} | {""}


def open_everywhere(page, book: Path, address: str, name: str) -> Iterator[str]:
    """Open a page from the web server and from disk, yielding its address each time."""
    for url in (f"{address}/{name}", (book / name).as_uri()):
        page.goto(url, wait_until="load")
        page.wait_for_timeout(300)
        yield url


def test_the_book_builds(build_faults: list[str]) -> None:
    if build_faults:
        pytest.fail("the book has warnings or failing pages:\n" + "\n".join(build_faults), False)


def test_every_source_page_is_in_the_book(book: Path) -> None:
    sources = {path.stem for path in (ROOT / "book").glob("*.md")}
    assert {path.stem for path in written_pages(book)} >= sources


def test_internal_links_resolve(book: Path) -> None:
    broken = []
    for path in pages(book):
        for reference in references(soup(path)):
            parts = urlsplit(reference)
            if parts.scheme or parts.netloc:
                continue
            address, fragment = urldefrag(reference)
            file = unquote(urlsplit(address).path)
            target = (path.parent / file).resolve() if file else path
            if target.is_dir():
                target /= "index.html"
            if not target.exists():
                broken.append(f"{path.relative_to(book)} -> {reference}")
            elif (
                target.suffix == ".html"
                and fragment
                and unquote(fragment) not in identifiers(target)
            ):
                broken.append(f"{path.relative_to(book)} -> {reference} (no such target)")
    assert not broken, "\n".join(broken)


def test_pictures_have_alternative_text(book: Path) -> None:
    bare = [
        f"{path.relative_to(book)}: {str(image)[:120]}"
        for path in written_pages(book)
        for image in soup(path).find_all("img")
        if not image.get("alt", "").strip() or image["alt"].startswith(("../", "_images"))
    ]
    assert not bare, "pictures without alternative text:\n" + "\n".join(bare)


def test_title_language_and_favicon(book: Path) -> None:
    for path in written_pages(book):
        document = soup(path)
        assert "Variational Transfer of Value Functions" in document.title.text, path
        assert document.html["lang"] == "en", path
        icon = document.find("link", rel="icon")
        assert icon is not None, path
        assert (path.parent / icon["href"]).is_file(), path


def test_equations_carry_the_numbers_of_the_thesis(book: Path) -> None:
    found = {}
    for path in written_pages(book):
        for equation in soup(path).select("div.math[id^=equation-eq-]"):
            if re.fullmatch(r"equation-eq-\d-\d+", equation["id"]):
                found[equation["id"]] = equation.select_one(".eqno").text.strip("()#¶\uf0c1 ")
    labels = [f"2-{i}" for i in range(1, 24)] + [f"5-{i}" for i in range(1, 16)]
    assert found == {f"equation-eq-{x}": x.replace("-", ".") for x in labels}


def test_equations_and_functions_lead_to_each_other(book: Path) -> None:
    reference = {path.name: soup(path) for path in (book / "book").glob("api_*.html")}
    for page in ("background", "method"):
        lines = soup(book / "book" / f"{page}.html").select("p.in-code")
        assert lines
        for link in (link for line in lines for link in line.find_all("a")):
            file, _, name = link["href"].partition("#")
            entry = reference[file].find(id=name).parent
            assert entry.select(f"a[href*='{page}.html#equation-eq-']"), name
            assert entry.select("div.math"), f"{name} shows no formula"


def test_every_symbol_leads_to_where_it_is_introduced(book: Path) -> None:
    rows = soup(book / "book" / "glossary.html").select("table tbody tr")
    plain = {
        " ".join(place.stripped_strings)
        for place in (row.select("td")[2] for row in rows)
        if len(place.find_all("a")) != len(place.text.split(","))
    }
    assert not plain


def test_the_gallery_shows_every_figure(book: Path) -> None:
    drawn = {
        f"{path.name}#{figure['id']}"
        for path in written_pages(book)
        if path.name != "index.html"
        for figure in soup(path).select("figure[id]")
    }
    shown = [link["href"] for link in soup(book / "book" / "index.html").select(".gallery a")]
    assert len(shown) == len(set(shown))
    assert set(shown) == drawn


def test_pages_with_code_offer_a_notebook_and_say_how_long_they_take(book: Path) -> None:
    for path in written_pages(book):
        source = (ROOT / "book" / path.name).with_suffix(".md").read_text(encoding="utf-8")
        links = [a["href"] for a in soup(path).select("a[href$='.ipynb']")]
        assert bool(links) == ("\nkernelspec:" in source[:500]), path.name
        for link in links:
            assert json.loads((path.parent / link).read_text(encoding="utf-8"))["cells"]
        if links:
            note = soup(path).select_one(".page-note").text
            assert re.match(r"Takes (about a second|\d+ (seconds|minutes)) to run", note), path.name


def test_pages_stay_light(book: Path) -> None:
    heavy = {
        path.name: round(path.stat().st_size / 1e6, 1)
        for path in written_pages(book)
        if path.stat().st_size > 4e6
    }
    assert not heavy, f"pages over 4 MB: {heavy}"


@pytest.fixture(scope="module")
def vendored(book: Path) -> None:
    """Skip what needs the browser scripts where the build could not fetch them and has said so."""
    if not (book / "_static" / "vendor" / "fetched").exists():
        pytest.skip("browser scripts could not be fetched: pages load them from public servers")


@pytest.mark.usefixtures("vendored")
def test_no_third_party_and_no_script_errors(book: Path, address: str, page) -> None:
    for path in written_pages(book):
        for url in open_everywhere(page, book, address, path.relative_to(book).as_posix()):
            assert not page.foreign, f"{url} asks {page.foreign}"
            assert not page.faults, f"{url}: {page.faults}"


@pytest.mark.usefixtures("vendored")
def test_equations_are_typeset(book: Path, address: str, page) -> None:
    for path in written_pages(book):
        count = len(soup(path).select("span.math, div.math"))
        if not count:
            continue
        for url in open_everywhere(page, book, address, path.relative_to(book).as_posix()):
            page.wait_for_function(
                "n => document.querySelectorAll('.math mjx-container').length >= n", arg=count
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
    for path in written_pages(book):
        page.goto(f"{address}/{path.relative_to(book).as_posix()}", wait_until="load")
        page.wait_for_timeout(500)
        excess = page.evaluate("document.scrollingElement.scrollWidth - innerWidth")
        assert excess <= 0, f"{path.name} is {excess} px wider than a screen of {width} px"


@pytest.mark.usefixtures("vendored")
def test_sliders_are_named_and_move_with_the_keyboard(book: Path, address: str, page) -> None:
    for path in written_pages(book):
        if "application/vnd.jupyter.widget-view+json" not in path.read_text(encoding="utf-8"):
            continue
        for url in open_everywhere(page, book, address, path.relative_to(book).as_posix()):
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


def panels_of(base: Settings, lambdas: Sequence[float], panels: int):
    return base, lambdas, panels, PSIS, COMPONENTS


ROOMS = panels_of(MGVT, slider_lambdas(MGVT), 1)
# The setting that each page's sliders start at, the values of lambda, its slider panels, and the
# values of psi and C.
SETTINGS = {
    "mazes": (MAZE_MGVT, MAZE_LAMBDAS, 2, MAZE_PSIS, MAZE_COMPONENTS),
    "rooms_evaluation": ROOMS,
    "cartpole": panels_of(CARTPOLE_MGVT, slider_lambdas(CARTPOLE_MGVT), 2),
    "mountain_car": panels_of(CAR_MGVT, CAR_LAMBDAS, 2),
}


@pytest.mark.usefixtures("vendored")
@pytest.mark.parametrize("name", SETTINGS)
def test_each_slider_shows_the_picture_of_its_setting(
    book: Path, address: str, page, name: str
) -> None:
    base, lambdas, panels, psis, components = SETTINGS[name]
    values = [[f"lambda = {x:.0e}," for x in lambdas], [f"psi = {x:g}," for x in psis]]
    values.append([f" {c} component" for c in components])
    for _ in open_everywhere(page, book, address, f"book/{name}.html"):
        page.wait_for_selector(".widget-slider .noUi-handle[aria-label]", state="attached")
        handles = page.locator(".widget-slider .noUi-handle").all()
        assert len(handles) == len(values) + panels - 1
        current = [f"lambda = {base.lambda_:.0e},", f"psi = {base.psi:g},", " 1 component"]
        assert_shown(page, current, panels)
        for axis, handle in enumerate(handles[panels - 1 :]):
            handle.focus()
            page.keyboard.press("Home")
            for at, text in enumerate(values[axis]):
                if at:
                    page.keyboard.press("ArrowRight")
                current[axis] = text
                assert_shown(page, current, panels)


MOMENTS = {
    "rooms_exploration": ((0, 50, 100), 2000, 1),
    "cartpole": ((0, 100, 200), 2000, 2),
    "mountain_car": ((0, 200, 500), 5000, 2),
    "mazes": ((0, 250, 500), 5000, 2),
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


SHOWN_BY_ITS_SLIDERS = """handle => {
  const figure = handle.closest("figure");
  const shown = [...figure.querySelectorAll(".widget-subarea img")].filter(i => i.offsetParent);
  const words = shown.map(i => i.alt.replaceAll("-", "\u2212").split(/[\\s:,;]+/)).flat();
  const handles = [...figure.querySelectorAll(".noUi-handle")];
  const set = handles.map(h => h.getAttribute("aria-valuetext"));
  return shown.length === 1 && set.every(value => words.includes(value));
}"""


@pytest.mark.usefixtures("vendored")
def test_the_formulas_of_the_method_move(book: Path, address: str, page) -> None:
    for url in open_everywhere(page, book, address, "book/method.html"):
        page.wait_for_selector(".widget-slider .noUi-handle[aria-label]", state="attached")
        handles = page.locator("figure .widget-slider .noUi-handle").all()
        assert len(handles) == 7, url
        for handle in handles:
            handle.focus()
            for key in ("Home", "ArrowRight", "End", "ArrowLeft"):
                page.keyboard.press(key)
                page.wait_for_function(SHOWN_BY_ITS_SLIDERS, arg=handle.element_handle())


@pytest.mark.usefixtures("vendored")
@pytest.mark.parametrize(
    ("figure", "lowest", "highest"),
    [
        ("fig-contraction", "gamma = 0.5.", "gamma = 0.99."),
        ("fig-td-bias", "c = 0:", "c = 0.5:"),
        ("fig-elbo", "mean -1.9 and deviation 0.15:", "mean 1.9 and deviation 0.9:"),
        ("fig-gibbs", "N = 10 and lambda = 0.25:", "N = 2560 and lambda = 16:"),
    ],
)
def test_the_formulas_of_the_background_move(
    book: Path, address: str, page, figure: str, lowest: str, highest: str
) -> None:
    for _ in open_everywhere(page, book, address, "book/background.html"):
        handles = page.locator(f"#{figure} .noUi-handle")
        handles.first.wait_for(state="attached")
        for key, text in (("Home", lowest), ("End", highest)):
            for handle in handles.all():
                handle.focus()
                page.keyboard.press(key)
            page.wait_for_function(
                "([id, text]) => { const v = [...document.querySelectorAll(`#${id} img`)]"
                ".filter(i => i.offsetParent); return v.length === 1 && v[0].alt.includes(text) }",
                arg=[figure, text],
            )


def assert_shown(page, setting: list[str], panels: int) -> None:
    """One picture is visible in each panel, and one description names the setting."""
    named = "v.filter(i => texts.every(t => i.alt.includes(t))).length === 1"
    test = f"([texts, panels]) => {{ const v = {VISIBLE}; return v.length === panels && {named} }}"
    page.wait_for_function(test, arg=[setting, panels])


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
    for path in written_pages(book):
        page.goto(f"{address}/{path.relative_to(book).as_posix()}", wait_until="load")
        page.evaluate("window.MathJax?.startup?.promise?.then(() => null)")
        page.evaluate(AXE.read_text(encoding="utf-8"))
        for theme, only in (("light", {}), ("dark", {"runOnly": ["color-contrast"]})):
            page.evaluate("theme => document.documentElement.dataset.theme = theme", theme)
            page.evaluate(FADED)
            found += [f"{path.name}, {theme}: {one}" for one in page.evaluate(FINDINGS, only)]
    assert not found, "\n".join(found)


def test_the_build_leaves_nothing_for_git(book: Path) -> None:
    inside = subprocess.run(["git", "rev-parse"], cwd=ROOT, capture_output=True, check=False)
    if inside.returncode:
        pytest.skip("a downloaded archive: there is no git that could take notice")
    for made in ("_build/html", "book/_static/vendor/fetched", ".venv"):
        done = subprocess.run(["git", "check-ignore", "-q", made], cwd=ROOT, check=False)
        assert done.returncode == 0, f"{made} is not ignored"
