"""The book on paper, in the system's own colours, without storage, and searched for any word."""

import pytest

DENIED = """
for (const name of ["localStorage", "sessionStorage"]) Object.defineProperty(window, name, {
  configurable: true, get() { throw new DOMException("denied", "SecurityError"); },
});
"""
DARK = "getComputedStyle(document.querySelector('.bd-article h1')).color"


def test_what_is_printed_from_the_dark_theme_is_dark_on_white(page, visit):
    page.emulate_media(color_scheme="dark")
    visit("book/rooms_evaluation.html")
    root = page.locator("html")
    assert root.get_attribute("data-theme") == "dark"
    page.emulate_media(media="print", color_scheme="dark")
    page.wait_for_function("document.documentElement.dataset.theme === 'light'")
    assert sum(map(int, page.evaluate(DARK)[4:-1].split(", "))) < 200
    page.emulate_media(media="screen", color_scheme="dark")
    page.wait_for_function("document.documentElement.dataset.theme === 'dark'")


@pytest.mark.usefixtures("vendored")
def test_in_forced_colours_keys_differ_and_sliders_have_tracks(page, visit):
    page.emulate_media(forced_colors="active")
    visit("book/rooms_evaluation.html")
    page.wait_for_selector(".widget-slider .noUi-target", state="attached")
    colours = page.evaluate(
        "[...document.querySelectorAll('.trainer .legend li')].slice(0, 3)"
        ".map(key => getComputedStyle(key, '::before').borderTopColor)"
    )
    assert len(set(colours)) == 3
    track = "getComputedStyle(document.querySelector('.noUi-target'))"
    assert page.evaluate(f"{track}.borderTopWidth") == "1px"
    assert page.evaluate(f"{track}.borderTopColor") == page.evaluate(f"{track}.color")


@pytest.mark.parametrize("word", ["constructor", "__proto__", "hasOwnProperty"])
def test_a_search_for_a_word_of_the_language_itself_ends(page, visit, word):
    visit(f"search.html?q={word}")
    page.wait_for_selector("#search-results > p, #search-results li")
    assert "searching" not in page.locator("#search-results").inner_text().lower()
    assert not page.faults


def test_without_storage_the_theme_can_be_chosen(page, visit):
    page.add_init_script(DENIED)
    visit("book/setting.html")
    modes = set()
    for _ in range(3):
        page.locator(".theme-switch-button:visible").first.click()
        modes.add(page.locator("html").get_attribute("data-mode"))
    assert modes == {"auto", "light", "dark"}
