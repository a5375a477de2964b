"""The panel that trains in a page: its parts, its runs against stored ones, and its use."""

import json
import os
import re
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest
import torch
from attrs import evolve

from vtbook import one_task, trainer
from vtbook.browser_panel import STATIC, static
from vtbook.checkpoints import pauses
from vtbook.experiments.cartpole import CARTPOLE
from vtbook.experiments.mountain_car import CAR
from vtbook.experiments.protocols import FROM_MEAN
from vtbook.experiments.rooms import PUBLISHED_GVT, ROOMS_CHANGE, ROOMS_EVALUATION, ROOMS_LIKELIHOOD
from vtbook.experiments.trust import PLACES
from vtbook.stages import STAGES
from vtbook.zero_shot import greedy_returns
from vtlab.native.build import PAGES, compile_page, page_module
from vtlab.native.runs import LANES, MOST_COMPONENTS, MOST_SOURCES, NO_CLIP
from vtlab.permutation import same_distribution_p
from vtlab.run import chosen_sources, prepare, targets
from vtlab.store import load, returns, weights
from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.promises import Record

bs4 = pytest.importorskip("bs4")
HERE = Path(__file__).resolve().parent / "trainer"
EVALUATION, LIKELIHOOD = ROOMS_EVALUATION.published, ROOMS_LIKELIHOOD.published
# Set to how many runs of each algorithm to compare with the engine's, where there are so many.
RUNS = int(os.environ.get("VTLIB_PAGE_RUNS", "20"))


def setup_of(html):
    return bs4.BeautifulSoup(html, "html.parser").find("script", type="application/json").string


@pytest.mark.parametrize("kernel", PAGES)
def test_the_kernel_in_the_repository_is_what_its_source_compiles_to(kernel, tmp_path):
    try:
        again = compile_page(kernel, tmp_path / "again.wasm")
    except RuntimeError as error:
        pytest.skip(str(error))
    assert again.read_bytes() == page_module(kernel).read_bytes(), (
        "run: python -m vtlab.native page"
    )


def test_all_kernels_of_the_pages_are_small():
    assert sum(page_module(kernel).stat().st_size for kernel in PAGES) < 60_000


def test_a_linter_finds_nothing_in_the_scripts(call):
    call("oxlint", "oxlint", "--deny-warnings", *STATIC.glob("*.js"), *HERE.glob("*.js"))


TASKS = {"rooms": (2.0, 8.0), "cartpole": (1.0, 0.2, 0.5), "mountain_car": (0.00125,)}


def test_the_parts_of_the_scripts(node):
    node(trainer.train_here(EVALUATION, (2.0, 8.0)), "--test", "parts.test.js")


@pytest.mark.parametrize("experiment", [CARTPOLE.published, CAR.published], ids=lambda x: x.name)
def test_the_stages_that_are_driven(experiment, node):
    html = trainer.train_here(experiment, TASKS[experiment.family.kernel])
    node(html, "--test", "driven.test.js")


# a step of another size shows early, before a return tells
@pytest.mark.parametrize(
    ("experiment", "label", "end"),
    [
        (LIKELIHOOD, "1-MGVT", 100),
        (LIKELIHOOD, "GVT", 500),
        (EVALUATION, "3-MGVT", 200),
        (CARTPOLE.published, "1-MGVT", 400),
        (CARTPOLE.published, "GVT", 400),
        (CAR.published, "1-MGVT", 400),
    ],
)
def test_runs_in_the_page_are_distributed_as_those_of_the_engine(experiment, label, end, node):
    count = min(RUNS, experiment.runs)
    rows, pool = np.arange(count) * (experiment.runs // count), weights(experiment.pool)
    tasks = load(experiment, "tasks").isel(run=rows)
    family, drawn = experiment.family, targets(experiment, rows)
    each = [family.kernel_parameters(drawn, row) for row in range(count)]
    C = experiment.algorithms[label].components
    algorithm = {"family": label.split("-")[-1], "components": C}
    numbers = zip(each, tasks.sources.values.tolist(), rows.tolist(), strict=True)
    runs = [{**algorithm, "task": t, "indices": s, "seed": seed} for t, s, seed in numbers]
    walls = getattr(experiment.family, "rooms", 4) - 1
    html = trainer.train_here(experiment, TASKS[experiment.family.kernel][:walls])
    here = zip(*json.loads(node(html, "runs.js", json.dumps([runs, end]))), strict=True)
    batch = prepare(experiment, label, rows, pool)
    list(pauses(batch, [end]))
    mu, L = batch.agent.mu.detach().numpy(), batch.agent.scale_tril
    there = batch.episodes.returns.mean().numpy(), mu, L.diagonal(dim1=2, dim2=3).numpy()
    # how far means have moved from their own sources' and how wide the posterior is now
    start = pool[tasks.sources].mean(1, keepdims=True)
    one, other = (
        (earned, np.linalg.norm(mu - start, axis=2).mean(1), np.log(diagonal).mean((1, 2)))
        for earned, mu, diagonal in (map(np.array, here), there)
    )
    stored = returns(experiment, label).learning.sel(iteration=end).isel(run=rows).values
    for x, y in [*zip(one, other, strict=True), (one[0], stored)]:
        assert same_distribution_p(x, y, np.random.default_rng(0)) > 1e-3


@pytest.mark.parametrize("place", [PLACES[0], PLACES[3]], ids=lambda x: x.title)
def test_the_recommended_method_earns_in_the_page_what_stored_runs_do(place, node):
    experiment, end, count = place.experiment, 500, RUNS
    drawn = targets(experiment, range(count))
    each = [experiment.family.kernel_parameters(drawn, row) for row in range(count)]
    sources = load(experiment, "tasks").sources.values[:count].tolist()
    told = {"family": "Trust", "components": 3}
    runs = [{**told, "task": each[i], "indices": sources[i], "seed": i} for i in range(count)]
    html = trainer.train_here(experiment, TASKS[experiment.family.kernel])
    here = [run[0] for run in json.loads(node(html, "runs.js", json.dumps([runs, end])))]
    stored = returns(experiment, "trust").learning.sel(iteration=end).values[:count]
    p = same_distribution_p(np.array(here), stored, np.random.default_rng(0))
    assert p > 1e-3


def test_the_page_chooses_who_plays_as_the_library_does(node):
    rng, told, chosen = np.random.default_rng(0), [], []
    for count in (1, 3, 10):
        for keep in (0.0, 0.5, 1.0):
            record, episodes = Record(count), []
            for episode in range(70):
                coin, normal = rng.uniform(), rng.standard_normal(count)
                record.choose(episode > 2, coin, normal)
                kept = rng.uniform() < keep
                earned = (float(rng.normal(0.8 if kept else 0.1, 0.1)), 0.8, 0.2)
                record.add(*earned)
                episodes.append([episode > 2, coin, normal.tolist(), earned])
            told.append([count, episodes])
            chosen.append(record.played)
    html = trainer.train_here(EVALUATION, (2.0, 8.0))
    assert json.loads(node(html, "choices.js", json.dumps(told))) == chosen


def test_a_page_grows_by_little_and_holds_the_sources_and_the_kernels_settings():
    # whatever a setup says cannot end its script
    start = {"family": "</script><b>", "sources": 2.5}
    html = trainer.train_here(EVALUATION, (2.0, 8.0), **start)
    setup = json.loads(setup_of(html))
    assert len(html.encode()) < 150_000
    scales = np.array(setup["scales"])[:, None]
    pool = scales * np.frombuffer(b64decode(setup["pool"]), np.int8).reshape(50, 484)
    np.testing.assert_allclose(pool, weights(EVALUATION.pool), 0, 0.501 * scales.max())
    assert b64decode(setup["wasm"]) == page_module("rooms").read_bytes()
    assert setup["start"] == start
    told = setup["settings"]
    assert (told["GVT"]["ddof"], told["GVT"]["kl_clip"], told["NT"]["clip"]) == (1, 100, NO_CLIP)
    found = told["MGVT"]["variance"], told["fine"]["epsilon_start"], told["GVT"]["scale"]
    assert found == pytest.approx((1e-5, 0.02, 1e4))


@pytest.mark.parametrize("experiment", [CARTPOLE.published, CAR.published], ids=lambda x: x.name)
def test_a_panel_says_that_its_fine_tuning_is_not_the_stored_one(experiment):
    kept, here = experiment.algorithms[FROM_MEAN], STAGES[experiment.family.kernel]
    assert isinstance(kept.learner, DDQNSettings)
    assert isinstance(here.algorithms["fine"], MellowTDSettings)
    assert here.note in trainer.train_here(experiment, TASKS[experiment.family.kernel])


def test_a_panel_of_two_pools_holds_both():
    html = trainer.train_here(EVALUATION, (2.0, 8.0), other=ROOMS_CHANGE.published)
    setup = json.loads(setup_of(html))
    assert (setup["pools"], len(setup["scales"])) == (2, 100)
    assert setup["experiments"] == ["rooms-evaluation", "rooms-distribution-change"]


@pytest.mark.parametrize("experiment", [CARTPOLE.published, CAR.published], ids=lambda x: x.name)
def test_sources_drive_as_well_as_before_they_were_rounded(experiment):
    sources = weights(experiment.pool)
    integers, scales = trainer.quantised(sources, np.int16)
    rounded = (integers * scales[:, None]).astype(np.float32)
    chosen = chosen_sources(experiment, range(experiment.runs))[:, :1]
    earned, again = (
        greedy_returns(experiment, torch.from_numpy(x[chosen]), "rounded")
        for x in (sources, rounded)
    )
    assert abs((earned - again).mean()) < 0.5


def test_the_kernel_has_room_for_all_that_the_controls_offer():
    most = re.findall(r'name="(\w+)" min="1" max="(\d+)"', static("trainer.html"))
    assert dict(most) == {"components": f"{MOST_COMPONENTS}", "sources": f"{MOST_SOURCES}"}
    for method in (x for stage in STAGES.values() for x in stage.algorithms.values()):
        settings, updates = getattr(method, "in_units", method), getattr(method, "updates", 1)
        samples = getattr(settings, "n_samples", 1) + 1
        assert updates * settings.minibatch <= 512
        assert updates * getattr(settings, "components", 1) * samples <= LANES * MOST_COMPONENTS
        assert settings.buffer <= 50_000


def test_curves_are_means_over_stored_runs():
    runs = returns(EVALUATION, "GVT")
    (curve,) = trainer.mean_curves({"GVT": runs}, 1_000)
    assert curve["iterations"] == list(range(100, 1_001, 100))
    assert curve["values"] == pytest.approx(runs.learning[:, :10].mean("run").values, abs=1e-3)
    assert curve["family"] == "GVT"


def shows(panel, part, pattern):
    """Wait until the text of a part of the panel has a pattern."""
    panel.locator(part, has_text=re.compile(pattern)).wait_for()


@pytest.fixture
def opened(book, page):
    """Opens a page from disk: its panel, ready to train. Nothing may fail on it."""

    def panel_of(name="rooms_evaluation"):
        file, _, setting = name.partition(".html#")
        address = (book / "book" / f"{file}.html").as_uri()
        page.goto(f"{address}#{setting}" if setting else address, wait_until="load")
        return page.locator(".trainer")

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
    shows(panel, ".says", "^Ready")
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
    shows(panel, ".says", "^Ready")
    panel.get_by_role("combobox").select_option(label="500 a second")
    panel.get_by_role("button", name="Run").click()
    shows(panel, ".iteration", "[1-9]")
    panel.get_by_role("button", name="Pause").click()
    shows(panel, ".says", "^Paused")
    paused = int(panel.locator(".iteration").inner_text().replace(",", ""))
    panel.get_by_role("button", name="Step").click()
    shows(panel, ".iteration", f"^{paused + 1:,}$")
    panel.get_by_label("keep what was learned when a door moves").check()
    panel.locator(".door").first.press("End")
    assert panel.locator(".marks line").count() == 1
    panel.get_by_label("psi").press("ArrowRight")
    shows(panel, ".says", "^Ready")
    assert panel.locator(".iteration").inner_text() == "0"


SEEN = """shown => {
  window.seen = [];
  const look = () => window.seen.push(Number(shown.innerText.replace(",", "")));
  new MutationObserver(look).observe(shown, { childList: true });
}"""


def test_where_motion_is_not_wanted_the_panel_moves_every_500_iterations_alone(opened, page):
    page.emulate_media(reduced_motion="reduce")
    panel = opened()
    shows(panel, ".says", "^Ready")
    panel.locator(".iteration").evaluate(SEEN)
    panel.get_by_role("combobox").select_option(label="500 a second")
    panel.get_by_role("button", name="Run").click()
    shows(panel, ".iteration", "^1,[0-4]")
    assert [t // 500 for t in page.evaluate("seen")] == [1, 2]


def test_where_motion_is_not_wanted_who_drives_is_seen_at_the_end_alone(opened, page):
    page.emulate_media(reduced_motion="reduce")
    panel = opened("mountain_car")
    shows(panel, ".says", "^Ready")
    panel.get_by_label("at the wheel").select_option(label="source 1")
    panel.get_by_role("button", name="Drive").click()
    shows(panel, ".drove", "source 1. It arrived after .*return")


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
    shows(panel, ".says", "^Ready")
    panel.get_by_label("Trust").check()
    assert panel.get_by_label("lambda").is_disabled()
    shown = trained(panel)
    assert shown["transfer"] > shown["none"] + 5
    shows(panel, ".plays", "plays; another source is of this task’s kind: 0.[5-9]")
    panel.get_by_role("button", name="Copy as Python").press("Enter")
    cell = panel.locator(".cell pre").inner_text()
    assert '"Trust",\n    sources=10' in cell
    assert link_of(page).startswith("panel=Trust_")


def test_who_drives_is_seen_while_training_goes_on(opened, page):
    panel = opened("mountain_car")
    shows(panel, ".says", "^Ready")
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
    shows(panel, ".legend .transfer", r"10 seeds 0\.\d")
    for part in ("mean", "band"):
        assert panel.locator(f".chart .{part}.transfer").get_attribute("points").count(",") > 100
    panel.get_by_role("button", name="Reset").click()
    shows(panel, ".says", "^Ready")
    assert not panel.locator(".chart .band.transfer").get_attribute("points")


def link_of(page):
    """The fragment of the page's address, once the panel has settled."""
    page.wait_for_timeout(500)
    return page.url.partition("#")[2]


def test_the_stories_of_the_first_page_are_as_their_lines_say(opened):
    panel = opened("index")
    for name in ("two sources", "sources that mislead"):
        panel.get_by_role("button", name=name).click()
        assert "hoose the mixture" in panel.locator(".look").inner_text()
        assert panel.get_by_label("Gaussian (GVT)").is_checked()
        assert finished(panel)["transfer"] < 0.05  # a story begins at once
        panel.get_by_label("mixture (MGVT)").check()
        assert trained(panel)["transfer"] > 0.7
    panel.get_by_role("button", name="as published").click()
    assert panel.get_by_label("number of sources").input_value() == "10"
    assert panel.get_by_label("mixture (MGVT)").is_checked()


def test_a_curve_is_pinned_before_lambda_moves_and_the_thesis_setting_comes_back(opened):
    panel = opened("mountain_car")
    trained(panel)
    keys = panel.locator(".legend li:visible")
    assert keys.count() == 4
    drawn = panel.locator(".chart .run.transfer").get_attribute("points")
    pin, power = panel.get_by_role("button", name="Pin this curve"), panel.get_by_label("lambda")
    usual = power.get_attribute("aria-valuetext")
    pin.press("Enter")
    power.press("Home")
    shows(panel, ".says", "^Ready")
    assert power.get_attribute("aria-valuetext") == "0"
    assert panel.locator(".chart .pinned").get_attribute("points") == drawn
    assert keys.count() == 4
    assert f"λ = {usual}" in keys.last.inner_text()
    pin.press("Enter")
    assert not panel.locator(".chart .pinned").get_attribute("points")
    panel.get_by_label("psi").press("End")
    panel.get_by_role("button", name="thesis’ settings").press("Enter")
    assert power.get_attribute("aria-valuetext") == usual
    assert panel.get_by_label("psi").input_value() == "0.5"


def test_another_task_is_drawn_and_the_optimum_is_that_of_the_task(opened):
    panel = opened("mountain_car")
    shows(panel, ".says", "^Ready")
    engine, optimum = panel.get_by_label("engine"), panel.locator(".optimum")
    speeds = set()
    for _ in range(3):
        panel.get_by_role("button", name="Another task").click()
        speed = float(engine.input_value())
        down = float(re.search(r" ([\d.]+)\)", optimum.get_attribute("transform"))[1])
        shown = -40 - 50 * (down - 22) / 178
        assert shown == pytest.approx(one_task.optimum(CAR.published.family, (speed,)), abs=1)
        assert 0.001 <= speed <= 0.0015
        speeds.add(speed)
    assert len(speeds) > 1


def test_a_setting_is_linked_from_disk_beside_those_of_sliders(opened, page):
    panel = opened("rooms_evaluation")
    shows(panel, ".says", "^Ready")
    assert not link_of(page)
    panel.get_by_label("lambda, weight of the KL term, as").press("Home")
    panel.get_by_label("seed").fill("77")
    panel.locator(".door").first.press("End")
    link = link_of(page)
    assert link == "panel=MGVT_-8.1_0.5_1_10_77_0_9.5_8"
    page.goto("about:blank")
    panel = opened(f"rooms_evaluation.html#psi=2&{link}")
    shows(panel, ".says", "^Ready")
    assert panel.get_by_label("lambda, weight of the KL term, as").input_value() == "-8.1"
    assert panel.get_by_label("seed").input_value() == "77"
    assert panel.locator(".door").first.get_attribute("aria-valuenow") == "9.5"
    panel.get_by_label("psi, share of the full gradient").last.press("ArrowRight")
    assert link_of(page).startswith("psi=2&panel=MGVT_-8.1_0.51")


def test_a_link_that_makes_no_sense_gives_a_setting_that_can_be_trained(opened, page):
    panel = opened("index.html#panel=%3Cb%3E_9e9_x_99_-3_1e99_7_x_1e9")
    shows(panel, ".says", "^Ready")
    held = [panel.locator(f"[name={x}]").input_value() for x in ("power", "components", "sources")]
    assert held == ["-1", "3", "1"]
    doors = panel.locator(".door").evaluate_all("x => x.map(y => y.ariaValueNow)")
    assert doors == ["5", "9.5"]
    panel.get_by_role("button", name="Step").click()
    shows(panel, ".iteration", "^1$")


def test_a_setting_is_copied_as_a_cell_that_trains_it(opened):
    panel = opened("index")
    shows(panel, ".says", "^Ready")
    panel.get_by_role("button", name="sources that mislead").click()
    panel.locator(".door").last.press("ArrowLeft")
    panel.get_by_label("lambda").press("Home")
    panel.get_by_role("button", name="Copy as Python").press("Enter")
    cell = panel.locator(".cell pre").inner_text()
    names = {}
    exec(cell.replace("iterations=5000", "iterations=100").replace("range(10)", "range(2)"), names)
    here, runs = names["here"], names["runs"]
    names["plt"].close("all")
    settings = evolve(PUBLISHED_GVT, lambda_=0.0)
    assert here.algorithms["GVT"] == settings
    assert here.pool.name == "rooms-3-fixed-lower-sources"
    np.testing.assert_allclose(targets(here, [0]).doors, [[2.0, 7.9]], rtol=1e-6)
    assert runs["learning"].shape == (2, 50)
