"""Every page of the built book in a browser: no third party, typeset, readable on any screen."""

import importlib.resources
import itertools
import re
from pathlib import Path

import pytest

SOURCES = Path(__file__).resolve().parents[1] / "book"


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


THEME = "theme => { document.documentElement.dataset.theme = theme }"
NAMED = "least => document.querySelectorAll('.noUi-handle[aria-label]').length >= least"
ANOTHER_PICTURE = """([panel, shown]) => {
  const seen = [...panel.querySelectorAll('img, svg.curves')].filter(one => one.checkVisibility());
  const words = seen[0]?.alt ?? seen[0]?.getAttribute('aria-label');
  return seen.length === 1 && !shown.includes(words) && words;
}"""


def test_a_page_asks_no_third_party_is_typeset_and_its_figures_move(opened, name):
    source = (SOURCES / f"{name}.md").read_text(encoding="utf-8")
    movable = len(re.findall(r"^(?:widgets\.)?(?:still|setting)_sliders\(", source, re.MULTILINE))
    assert opened.locator("mjx-merror").count() == 0
    opened.wait_for_function(NAMED, arg=movable)
    panels = opened.locator(".widget-subarea:has(.noUi-handle)").all()
    assert len(panels) == movable
    for panel in panels:
        for handle in panel.locator(".noUi-handle").all():
            assert handle.get_attribute("aria-label") not in (None, "", "null")
            shown, texts = [], set()
            for key in ("Home", "End", "ArrowLeft"):
                handle.press(key)
                picture = opened.wait_for_function(
                    ANOTHER_PICTURE, arg=[panel.element_handle(), shown]
                )
                shown.append(picture.json_value())
                texts.add(handle.get_attribute("aria-valuetext"))
            assert len(texts) == len(shown)
    assert not opened.foreign
    assert not opened.faults


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
    // a formula holds a copy to be spoken, and a box that is folded hides its text on purpose
    return one.innerText?.trim() && !one.closest('.math, .toggle-hidden')
      && (cuts(overflowX) && one.scrollWidth > one.clientWidth + 1
        || cuts(overflowY) && one.scrollHeight > one.clientHeight + 1);
  };
  const shown = what => [...column.querySelectorAll(what)].filter(one => one.checkVisibility());
  return [
    ...shown('table, figure, img').filter(beyond).map(one => 'beyond: ' + said(one)),
    ...shown('*').filter(clipped).map(one => 'clipped: ' + said(one)),
    ...shown('.whole').filter(one => one.getClientRects().length > 1).map(said),
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


AXE = importlib.resources.files("axe_playwright_python") / "axe.min.js"
OFF = {"enabled": False}
FINDINGS = """async ([where, only]) => {
  const found = await axe.run(where, {resultTypes: ["violations"], ...only});
  return found.violations.filter(one => ["serious", "critical"].includes(one.impact))
    .map(one => `${one.id} (${one.nodes.length}): ${one.nodes[0].html.slice(0, 200)}`);
}"""
# Of formulas, blocks of code and signatures, all alike and of thousands of parts, three are kept.
THINNED = """() => {
  for (const alike of ['mjx-container', '.highlight', '.sig'])
    for (const one of [...document.querySelectorAll(alike)].slice(3)) one.replaceChildren('...');
}"""
# Of all texts in the same colours one: to see whether they contrast takes longest.
EXAMPLES = """() => {
  const found = new Map();
  for (const one of document.body.querySelectorAll('*')) {
    one.removeAttribute('data-example');
    const own = [...one.childNodes].some(part => part.nodeType === 3 && part.data.trim());
    if (!own || !one.checkVisibility()) continue;
    const { color, font } = getComputedStyle(one), seen = new Set([color, font]);
    for (let box = one; box; box = box.parentElement) {
      const { backgroundColor, backgroundImage, opacity } = getComputedStyle(box);
      seen.add(backgroundColor).add(backgroundImage).add(opacity);
      if (backgroundColor.startsWith('rgb(')) break;
    }
    found.set([...seen].join(), one);
  }
  for (const one of found.values()) one.setAttribute('data-example', '');
}"""
WIDE = "[...document.querySelectorAll('pre')].filter(e => e.scrollWidth > e.clientWidth)"
AT_ONCE = "*, ::before, ::after { transition: none !important; animation: none !important; }"


def test_no_serious_barrier_to_reading(opened):
    colours = {"include": ["[data-example]"]}, {"runOnly": ["color-contrast"]}
    others = {"include": ["html"]}, {"rules": {"color-contrast": OFF}}
    opened.evaluate(THINNED)
    opened.add_style_tag(content=AT_ONCE)  # colours would fade over
    opened.set_viewport_size({"width": 1280, "height": 900})
    opened.wait_for_timeout(1000)  # the theme notes a while later what can be scrolled by keys
    opened.wait_for_function(f"{WIDE}.every(e => e.tabIndex == 0)")
    opened.evaluate(AXE.read_text(encoding="utf-8"))
    assert opened.evaluate(FINDINGS, others) == []
    for theme in ("light", "dark"):
        opened.evaluate(THEME, theme)
        opened.evaluate(EXAMPLES)
        assert opened.evaluate(FINDINGS, colours) == [], theme
