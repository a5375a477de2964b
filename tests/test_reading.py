"""The book on paper, and without storage."""

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


def test_without_storage_the_theme_can_be_chosen(page, visit):
    page.add_init_script(DENIED)
    visit("book/setting.html")
    modes = set()
    for _ in range(3):
        page.locator(".theme-switch-button:visible").first.click()
        modes.add(page.locator("html").get_attribute("data-mode"))
    assert modes == {"auto", "light", "dark"}
