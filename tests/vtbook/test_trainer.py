"""The panel that trains in a page: its parts, and its runs against stored ones."""

import json
import os
import re
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest

from vtbook import trainer
from vtbook.browser_panel import STATIC, static
from vtbook.checkpoints import pauses
from vtbook.experiments.cartpole import CARTPOLE
from vtbook.experiments.mountain_car import CAR
from vtbook.experiments.rooms import ROOMS_EVALUATION, ROOMS_LIKELIHOOD
from vtbook.experiments.trust import PLACES
from vtbook.stages import STAGES
from vtlab.native.build import PAGES, compile_page, page_module
from vtlab.native.runs import LANES, MOST_COMPONENTS, MOST_SOURCES, NO_CLIP
from vtlab.permutation import same_distribution_p
from vtlab.run import prepare, targets
from vtlab.store import load, returns, weights
from vtlib.promises import Record

bs4 = pytest.importorskip("bs4")
HERE = Path(__file__).resolve().parent / "trainer"
EVALUATION, LIKELIHOOD = ROOMS_EVALUATION, ROOMS_LIKELIHOOD
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


def test_a_linter_finds_nothing_in_the_scripts(call):
    call("oxlint", "oxlint", "--deny-warnings", *STATIC.glob("*.js"), *HERE.glob("*.js"))


TASKS = {"rooms": (2.0, 8.0), "cartpole": (1.0, 0.2, 0.5), "mountain_car": (0.00125,)}


def test_the_parts_of_the_scripts(node):
    node(trainer.train_here(EVALUATION, (2.0, 8.0)), "--test", "parts.test.js")


@pytest.mark.parametrize("experiment", [CARTPOLE, CAR], ids=lambda x: x.name)
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
        (CARTPOLE, "1-MGVT", 400),
        (CARTPOLE, "GVT", 400),
        (CAR, "1-MGVT", 400),
        (PLACES[0].experiment, "trust", 300),
        (PLACES[3].experiment, "trust", 300),
    ],
)
def test_runs_in_the_page_are_distributed_as_those_of_the_engine(experiment, label, end, node):
    count = min(RUNS, experiment.runs)
    rows, pool = np.arange(count) * (experiment.runs // count), weights(experiment.pool)
    tasks = load(experiment, "tasks").isel(run=rows)
    family, drawn = experiment.family, targets(experiment, rows)
    each = [family.kernel_parameters(drawn, row) for row in range(count)]
    C, kind = experiment.algorithms[label].components, label.split("-")[-1]
    algorithm = {"family": "Trust" if kind == "trust" else kind, "components": C}
    numbers = zip(each, tasks.sources.values.tolist(), rows.tolist(), strict=True)
    runs = [{**algorithm, "task": t, "indices": s, "seed": seed} for t, s, seed in numbers]
    walls = getattr(experiment.family, "rooms", 4) - 1
    html = trainer.train_here(experiment, TASKS[experiment.family.kernel][:walls])
    here = zip(*json.loads(node(html, "runs.js", json.dumps([runs, end]))), strict=True)
    batch = prepare(experiment, label, rows, pool)
    list(pauses(batch, [end]))
    learned = getattr(batch.agent, "learned", batch.agent)
    mu, L = learned.mu.detach().numpy(), learned.scale_tril
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


def test_the_page_chooses_who_plays_as_the_library_does(node):
    rng, told, chosen = np.random.default_rng(0), [], []
    for count in (1, 3, 10):
        for keep in (0.0, 0.5, 1.0):
            record, episodes, lost = Record(count), [], []
            for episode in range(70):
                coin, normal = rng.uniform(), rng.standard_normal(count)
                record.choose(episode > 2, coin, normal)
                lost.append(record.lost)
                kept = rng.uniform() < keep
                earned = (float(rng.normal(0.8, 0.1)) if kept else 0.0, 0.8, 0.2)
                record.add(*earned)
                episodes.append([episode > 2, coin, normal.tolist(), earned])
            told.append([count, episodes])
            chosen.append([record.played, lost])
    assert {x for _, lost in chosen for x in lost} == {False, True}
    html = trainer.train_here(EVALUATION, (2.0, 8.0))
    assert json.loads(node(html, "choices.js", json.dumps(told))) == chosen


def test_a_page_grows_by_little_and_holds_the_sources_and_the_kernels_settings():
    # whatever a setup says cannot end its script
    start = {"family": "</script><b>", "sources": 2.5}
    html = trainer.train_here(EVALUATION, (2.0, 8.0), **start)
    setup = json.loads(setup_of(html))
    assert len(html.encode()) < 150_000
    scales = np.array(setup["scales"])[:, None]
    pool = scales * np.frombuffer(b64decode(setup["pool"]), np.int16).reshape(50, 484)
    np.testing.assert_allclose(pool, weights(EVALUATION.pool), 0, 0.53 * scales.max())
    assert b64decode(setup["wasm"]) == page_module("rooms").read_bytes()
    assert setup["start"] == start
    told = setup["settings"]
    assert (told["GVT"]["ddof"], told["GVT"]["kl_clip"], told["NT"]["clip"]) == (1, 100, NO_CLIP)
    found = told["MGVT"]["variance"], told["fine"]["epsilon_start"], told["GVT"]["scale"]
    assert found == pytest.approx((1e-5, 0.02, 1e4))


def test_the_kernel_has_room_for_all_that_the_controls_offer():
    offered = static("trainer_mixture.html") + static("trainer.html")
    most = re.findall(r'name="(\w+)" min="1" max="(\d+)"', offered)
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
