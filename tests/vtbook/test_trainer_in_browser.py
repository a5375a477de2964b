"""The panel that trains in a page, as its reader uses it in a browser."""

import re

import pytest

from vtbook import trainer
from vtbook.experiments.mountain_car import CAR

pytest.importorskip("playwright")  # or a book would be built for nothing


def shows(panel, part, pattern):
    """Wait until the text of a part of the panel has a pattern."""
    panel.locator(part, has_text=re.compile(pattern)).wait_for()


@pytest.fixture
def opened(book, page):
    """Opens a page from disk: its panel, ready to train. Nothing may fail on it."""

    def panel_of(name="rooms_evaluation"):
        page.goto((book / "book" / f"{name}.html").as_uri(), wait_until="load")
        panel = page.locator(".trainer")
        shows(panel, ".says", "^Ready|SIMD")
        return panel

    yield panel_of
    assert not page.faults


def trained(panel):
    """The learning returns after a training that the reader starts."""
    shows(panel, ".says", "^Ready")
    panel.get_by_role("button", name="Run").click()
    return finished(panel)


def finished(panel):
    """The learning returns in the key of the chart after training, by the name of their run."""
    shows(panel, ".says", "^Done")
    names = ("transfer", "fine", "none")
    texts = {x: panel.locator(f".legend .{x}").inner_text() for x in names}
    return {x: float(text.split()[-1].replace("−", "-")) for x, text in texts.items()}


def test_a_reader_moves_the_doors_trains_and_sees_transfer_pay(opened, page):
    panel, messages = opened(), []
    page.on("console", lambda message: messages.append(message.text))  # not the theme's
    lower, upper = panel.get_by_role("slider", name="Lower door"), panel.locator(".door").last
    lower.drag_to(panel.locator(".map"))
    assert float(lower.get_attribute("aria-valuenow")) > 3
    assert lower.evaluate("door => getComputedStyle(door).outlineStyle") == "none"
    upper.press("ArrowLeft")
    assert upper.get_attribute("aria-valuenow") == "7.9"
    shown = trained(panel)
    assert shown["transfer"] > shown["none"] + 0.3
    ends = {
        x: panel.locator(f".chart .run.{x}").get_attribute("points").split(",")[-1] for x in shown
    }
    assert float(ends["transfer"]) < float(ends["none"]) - 50
    assert panel.locator(".map .last").get_attribute("points").count(",") > 5
    assert not messages
    assert not page.foreign


def test_training_stops_at_once_steps_and_begins_anew(opened):
    panel = opened()
    panel.get_by_role("combobox").select_option(label="500 a second")
    panel.get_by_role("button", name="Run").click()
    shows(panel, ".iteration", "[1-9]")
    panel.get_by_role("button", name="Pause").click()
    shows(panel, ".says", "^Paused")
    paused = int(panel.locator(".iteration").inner_text().replace(",", ""))
    panel.get_by_role("button", name="Step").click()
    shows(panel, ".iteration", f"^{paused + 1:,}$")
    panel.locator(".more > summary").click()
    panel.get_by_label("keep what was learned when a door moves").check()
    panel.locator(".door").first.press("End")
    assert panel.locator(".marks line").count() == 1
    panel.get_by_label("psi").press("ArrowRight")
    shows(panel, ".says", "^Ready")
    assert panel.locator(".iteration").inner_text() == "0"


def test_without_vector_instructions_the_panel_says_so(opened, page):
    page.add_init_script("WebAssembly.validate = () => false")
    panel = opened()
    assert "SIMD" in panel.locator(".says").inner_text()
    assert panel.locator(".go").is_disabled()


@pytest.mark.parametrize("name", ["cartpole", "mountain_car"])
def test_a_cart_and_a_car_train_better_than_without_transfer_and_are_driven(name, opened, page):
    panel = opened(name)
    shown = trained(panel)
    assert shown["transfer"] > shown["none"] + 3
    slider, wheel = panel.locator(".task input").first, panel.get_by_label("at the wheel")
    slider.press("ArrowRight")
    shows(panel, ".says", "^Ready")
    for who in ("source 1", "the sources’ mean", "a draw from the posterior", "you"):
        wheel.select_option(label=who)
        panel.get_by_role("button", name="Drive").click()
        if who == "you":
            page.keyboard.down("ArrowRight")
        shows(panel, ".drove", f"{who}. It (balanced|fell|arrived|never).*return")
    assert panel.locator(".plane .now").get_attribute("points").count(",") > 5
    assert not page.foreign


def test_the_recommended_method_says_who_plays_and_has_nothing_to_set(opened, page):
    panel = opened("mountain_car")
    panel.get_by_label("Trust").check()
    assert panel.get_by_label("lambda").is_disabled()
    shown = trained(panel)
    assert shown["transfer"] > shown["none"] + 5
    shows(panel, ".plays", "plays; an untried one fits with probability 0.[5-9]")
    strip = panel.locator(".players rect")  # an episode after the other, to the end of the run
    widths = strip.evaluate_all("all => all.map((one) => one.width.baseVal.value)")
    assert len(widths) > 10
    assert sum(widths) == pytest.approx(372 - 34, abs=1)
    assert panel.locator(".players .source").count() > len(widths) / 2
    panel.get_by_label("mixture").check()
    shows(panel, ".says", "^Ready")
    assert strip.count() == 0


def test_who_drives_is_seen_while_training_goes_on(opened, page):
    panel = opened("mountain_car")
    panel.get_by_role("combobox", name="speed").select_option(label="50 a second")
    panel.get_by_role("button", name="Run").click()
    shows(panel, ".drove", "In training")
    panel.get_by_role("button", name="Drive").click()
    shows(panel, ".drove", "At the wheel")
    before = panel.locator(".iteration").inner_text()
    page.wait_for_timeout(500)
    assert panel.locator(".iteration").inner_text() != before
    assert "At the wheel" in panel.locator(".drove").inner_text()


def test_two_rooms_have_one_door_and_ten_seeds_are_drawn_with_their_mean_and_band(opened):
    panel = opened("rooms_exploration")
    assert panel.locator(".door").count() == 1
    assert panel.get_by_label("Gaussian (GVT)").is_checked()
    assert trained(panel)["transfer"] > 0.2
    panel.get_by_role("button", name="Ten seeds").click()
    shows(panel, ".says", "^10 seeds: ")
    shows(panel, ".legend .transfer", r"10 seeds: 0\.\d")
    for part in ("mean", "band"):
        assert panel.locator(f".chart .{part}.transfer").get_attribute("points").count(",") > 100
    panel.get_by_role("button", name="Reset").click()
    shows(panel, ".says", "^Ready")
    assert not panel.locator(".chart .band.transfer").get_attribute("points")


def test_the_stories_of_the_first_page_are_as_their_lines_say(opened):
    panel = opened("index")
    panel.get_by_role("button", name="two sources").click()
    assert panel.get_by_label("Gaussian (GVT)").is_checked()
    assert finished(panel)["transfer"] < 0.05  # a story begins at once
    panel.get_by_label("mixture (MGVT)").check()
    assert trained(panel)["transfer"] > 0.7
    panel.get_by_role("button", name="sources that mislead").click()
    assert panel.get_by_label("Gaussian (GVT)").is_checked()
    assert finished(panel)["transfer"] < 0.05
    power = panel.get_by_label("lambda")
    power.fill(str(float(power.input_value()) - 2))
    assert power.get_attribute("aria-valuetext") == "10⁻⁵"
    assert trained(panel)["transfer"] > 0.7
    assert panel.locator(".chart .pinned").get_attribute("points")  # what came before stays
    panel.get_by_role("button", name="Trust").click()
    assert finished(panel)["transfer"] > 0.6  # of what it has learned, for the sources fail
    panel.get_by_role("button", name="as published").click()
    assert panel.get_by_label("number of sources").input_value() == "10"
    assert panel.get_by_label("mixture (MGVT)").is_checked()


def test_a_curve_is_pinned_before_lambda_moves_and_the_thesis_setting_comes_back(opened):
    panel = opened("mountain_car")
    trained(panel)
    keys = panel.locator(".legend li:visible")
    assert keys.count() == 4
    drawn = panel.locator(".chart .run.transfer").get_attribute("points")
    pin, power = panel.get_by_role("button", name="pin"), panel.get_by_label("lambda")
    usual = power.get_attribute("aria-valuetext")
    assert float(panel.locator(".weight").inner_text()) > 0
    pin.press("Enter")
    power.press("Home")
    shows(panel, ".says", "^Ready")
    assert power.get_attribute("aria-valuetext") == "0"
    assert panel.locator(".chart .pinned").get_attribute("points") == drawn
    assert keys.count() == 4
    assert f"λ = {usual}," in keys.last.inner_text()
    pin.press("Enter")
    assert not panel.locator(".chart .pinned").get_attribute("points")
    panel.get_by_label("psi").press("End")
    panel.get_by_role("button", name="thesis’ settings").press("Enter")
    assert power.get_attribute("aria-valuetext") == usual
    assert panel.get_by_label("psi").input_value() == "0.5"


def test_another_task_is_drawn_and_the_optimum_is_that_of_the_task(opened):
    panel = opened("mountain_car")
    engine, optimum = panel.get_by_label("engine"), panel.locator(".optimum")
    speeds = set()
    for _ in range(3):
        panel.get_by_role("button", name="Another task").click()
        speed = float(engine.input_value())
        down = float(re.search(r" ([\d.]+)\)", optimum.get_attribute("transform"))[1])
        shown = -40 - 50 * (down - 22) / 178
        assert shown == pytest.approx(trainer.optimum(CAR.family, (speed,)), abs=1)
        assert 0.001 <= speed <= 0.0015
        speeds.add(speed)
    assert len(speeds) > 1
