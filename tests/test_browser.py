"""What moves in the built book, in a browser: sliders, links to their states, the race."""

import pytest

from vtbook.experiments.grids import POSTERIORS
from vtbook.experiments.protocols import transfer_settings
from vtbook.experiments.rooms import ROOMS_EVALUATION, ROOMS_LAMBDAS


def handles_of(page):
    """The sliders of a page, once they are there and have their names."""
    page.wait_for_selector(".widget-slider .noUi-handle[aria-label]", state="attached")
    return page.locator(".widget-slider .noUi-handle").all()


SHOWN = (
    "[...document.querySelectorAll('.widget-subarea :is(img, svg.curves)')]"
    ".filter(one => one.checkVisibility())"
)


def assert_shown(page, setting):
    """One picture is visible, and its description names the setting."""
    words = "(i.alt ?? i.getAttribute('aria-label'))"
    named = f"v.every(i => texts.every(t => {words}.includes(t)))"
    test = f"texts => {{ const v = {SHOWN}; return v.length === 1 && {named} }}"
    page.wait_for_function(test, arg=setting)


@pytest.mark.usefixtures("vendored")
def test_sliders_show_the_picture_of_their_setting_and_a_state_can_be_linked(visit, page):
    base = transfer_settings(ROOMS_EVALUATION, "1-MGVT")
    visit("book/rooms_evaluation.html")
    url = page.url
    power, psi, _ = handles_of(page)
    assert "#" not in page.url
    power.press("End")
    psi.press("Home")
    assert page.url == f"{url}#lambda={len(ROOMS_LAMBDAS) - 1}&psi=0"
    linked = [f"lambda = {ROOMS_LAMBDAS[-1]:.0e},", "psi = 0,", " 1-MGVT;"]
    assert_shown(page, linked)
    page.reload()
    handles_of(page)
    assert_shown(page, linked)
    page.goto("about:blank")
    page.goto(f"{url}#psi=x&posterior=2&nothing=1")
    handles_of(page)
    usual = [f"lambda = {base.lambda_:.0e},", f"psi = {base.psi:g},"]
    assert_shown(page, [*usual, f" {POSTERIORS[2]};"])


STEP = "Number(document.querySelector('.race input').value)"


def test_the_race_plays_by_itself_pauses_and_is_scrubbed(visit, page):
    visit("book/index.html")
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
    label = page.locator(".race .squares").get_attribute("aria-label")
    for text in counts.all_inner_texts():
        assert text.removeprefix("goal reached ") in label


def test_robots_walk_through_mazes_and_follow_what_is_chosen(visit, page):
    visit("book/mazes.html")
    panel = page.locator(".walks.ready")
    squares, told = panel.locator("canvas"), panel.locator(".count")
    panel.locator("button").scroll_into_view_if_needed()

    def place():
        return int(panel.locator("input").input_value())

    def drawn():
        return squares.evaluate_all("all => all.map((one) => one.toDataURL())")

    panel.locator("input").press("Home")
    begun = drawn()
    panel.locator("button").click()
    page.wait_for_timeout(1000)
    panel.locator("button").click()
    assert 0 < place() < 1009
    assert all(a != b for a, b in zip(begun, drawn(), strict=True))
    panel.locator("input").press("End")
    greedy, label = drawn(), panel.locator(".squares").get_attribute("aria-label")
    assert all(text in label for text in told.all_inner_texts())
    panel.locator("select.mode").select_option("1")
    same = [a == b for a, b in zip(greedy, drawn(), strict=True)]
    assert same == [True, True, True, False, False, False]  # only posteriors are drawn from
    panel.locator("select.maze").select_option("1")
    assert panel.locator("figure:visible").count() == 5


def test_the_corridor_is_drawn_acted_and_updated_by_keys(visit, page):
    page.emulate_media(reduced_motion="reduce")
    visit("book/idea.html")
    band = page.locator(".corridor polygon")
    before, said = band.get_attribute("points"), page.locator(".corridor .said")
    for button in ("update", "draw", "act"):  # the first has nothing to learn from
        page.locator(f".corridor button[value={button}]").press("Enter")
        assert band.get_attribute("points") == before
    assert "no treasure" in said.inner_text()  # for the first sample leads away from it
    page.locator(".corridor button[value=update]").press("Enter")
    assert band.get_attribute("points") != before
    page.locator(".corridor button[value=again]").press("Enter")
    assert band.get_attribute("points") == before
    page.locator(".corridor input").check()
    assert band.get_attribute("points") != before


def test_the_contents_fold_the_parts_where_the_reader_is_not(visit, page):
    folded = page.locator(".bd-sidebar-primary details.part")
    for where, unfolded in {"idea": [], "method": ["The thesis, recomputed"]}.items():
        visit(f"book/{where}.html")
        assert folded.count() == 3
        opened = page.locator(".bd-sidebar-primary details.part[open] p.caption")
        assert opened.all_inner_texts() == unfolded


def test_claims_are_filtered_by_verdict_and_page(visit, page):
    visit("book/scorecard.html")
    shown, count = page.locator(".scorecard li:visible"), page.locator(".scorecard output")
    assert count.inner_text() == f"{shown.count()} claims"
    first = shown.count()  # those that are not reproduced
    page.select_option(".scorecard select[name=verdict]", "")
    assert 0 < first < shown.count()
    page.select_option(".scorecard select[name=verdict]", "not reproduced")
    assert shown.count() == first
    page.select_option(".scorecard select[name=page]", "mazes")
    assert shown.count() == 1
    assert shown.locator("a").get_attribute("href") == "mazes.html"
