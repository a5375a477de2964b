"""The stored results of the book: complete, small, of the present configuration, recomputable."""

import secrets

import numpy as np
import pytest

from vtlib.experiments import EXPERIMENTS, POOLS
from vtlib.experiments.verify import check_heads, results_of
from vtlib.experiments.work import load_result
from vtlib.store import results_folder

ROOT = results_folder()
PAIRS = list(dict.fromkeys(pair for name in EXPERIMENTS for pair in results_of(name)))
DRAWN = 6
# not all sources are solved
SHORT = {"cartpole-sources-ddqn-separate", "mountain-car-sources"}
CORNER = "rooms-3-corner-sources"  # meant to show what is lost: most were never rewarded


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_result_is_stored_under_the_present_configuration(name):
    for owner, label in results_of(name):
        arrays, note = load_result(owner, label, ROOT)
        assert note["machine"]["torch"]
        for values in arrays.values():
            assert np.isfinite(values).all()


@pytest.mark.parametrize("name", sorted(set(POOLS) - SHORT - {CORNER}))
def test_sources_are_solved(name):
    sources, _ = load_result(name, "sources", ROOT)
    assert len(sources["weights"]) == POOLS[name].count
    assert sources["solved"].all()
    missing = sources["optimum"] - sources["greedy"]
    assert (missing <= (1 - POOLS[name].required) * np.abs(sources["optimum"]) + 1e-6).all()


@pytest.mark.parametrize("name", sorted(SHORT))
def test_sources_that_fall_short_were_trained_to_the_limit(name):
    sources, _ = load_result(name, "sources", ROOT)
    assert len(sources["weights"]) == POOLS[name].count
    assert 0.5 < sources["solved"].mean() < 1


def test_sources_from_the_corner_are_as_they_were_after_their_iterations():
    sources, _ = load_result(CORNER, "sources", ROOT)
    assert (sources["iterations"] == POOLS[CORNER].limit).all()
    rewarded = (sources["weights"] != 0).any(1)
    assert not sources["solved"][~rewarded].any()
    assert 0 < sources["solved"].sum() < rewarded.sum() < len(rewarded) / 2


def test_results_stay_small():
    sizes = [path.stat().st_size for path in ROOT.rglob("*") if path.is_file()]
    assert sum(sizes) < 30e6


def test_nothing_stored_is_stray():
    known = {f"{owner}/{label}" for owner, label in PAIRS}
    stored = (path.relative_to(ROOT).as_posix() for path in ROOT.rglob("*.json"))
    found = {name.removesuffix(".json") for name in stored}
    assert found == known


def test_runs_drawn_at_random_recompute():
    seed = secrets.randbits(32)
    rng = np.random.default_rng(seed)
    for at in rng.choice(len(PAIRS), DRAWN, replace=False):
        owner, label = PAIRS[at]
        count = len(load_result(owner, label, ROOT)[0].get("run", [0]))
        member = int(rng.integers(count))
        assert check_heads(owner, label, ROOT, [member]).wrong == [], f"drawn with seed {seed}"
