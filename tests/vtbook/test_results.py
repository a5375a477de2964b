"""The stored results of the book: complete, small, of the present configuration, recomputable."""

import secrets

import numpy as np
import pytest

from vtbook.experiments import EXPERIMENTS, POOLS
from vtlib.experiments import load, schedule
from vtlib.experiments.heads import check_heads
from vtlib.experiments.ledger import recorded
from vtlib.experiments.store import results_behind, results_folder
from vtlib.experiments.whole import check_runs, count_of, expected_seconds

ROOT = results_folder()
RESULTS = {f"{o.name}/{label}": (o, label) for o, label in results_behind(EXPERIMENTS.values())}
HEADS, WHOLE_SECONDS, LONGEST = 4, 100, 40
# not all sources are solved
SHORT = {
    "cartpole-sources",
    "cartpole-sources-ddqn-separate",
    "cartpole-sources-mellow-separate",
    "maze-sources",
    "mountain-car-sources",
    "mountain-car-sources-equations",
}
UNCHECKED = "mountain-car-sources-unchecked"  # as those that nobody had looked at
CORNER = "rooms-3-corner-sources"  # meant to show what is lost: most were never rewarded


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_result_is_stored_under_the_present_configuration(name):
    for owner, label in results_behind([EXPERIMENTS[name]]):
        found = load(owner, label)
        assert found.attrs["machine"]["torch"]
        for values in found.values():
            assert np.isfinite(values).all()


@pytest.mark.parametrize("name", sorted(set(POOLS) - SHORT - {CORNER, UNCHECKED}))
def test_sources_are_solved(name):
    sources = load(POOLS[name], "sources")
    assert sources.solved.all()
    missing = sources.optimum - sources.greedy
    assert (missing <= (1 - POOLS[name].required) * np.abs(sources.optimum) + 1e-6).all()


@pytest.mark.parametrize("name", sorted(SHORT))
def test_sources_that_fall_short_were_trained_to_the_limit(name):
    sources = load(POOLS[name], "sources")
    assert 0.5 < sources.solved.mean() < 1
    pool = POOLS[name]
    assert (sources.iterations[~sources.solved] <= pool.limit * pool.attempts).all()


def test_sources_from_the_corner_are_as_they_were_after_their_iterations():
    sources = load(POOLS[CORNER], "sources")
    assert (sources.iterations == POOLS[CORNER].limit).all()
    rewarded = (sources.weights != 0).any("weights_1")
    assert not sources.solved[~rewarded].any()
    assert 0 < sources.solved.sum() < rewarded.sum() < len(rewarded) / 2


def test_unchecked_sources_are_as_they_were_after_their_iterations():
    sources = load(POOLS[UNCHECKED], "sources")
    assert (sources.iterations == POOLS[UNCHECKED].iterations).all()
    assert sources.solved.mean() < 0.5


def test_results_stay_small():
    sizes = [path.stat().st_size for path in ROOT.rglob("*") if path.is_file()]
    assert sum(sizes) < 30e6


def test_nothing_stored_is_stray():
    stored = (path.relative_to(ROOT).as_posix() for path in ROOT.rglob("*.json"))
    # the guide's own are those of its script, see test_guide
    names = {name.removesuffix(".json") for name in stored if not name.startswith("guide/")}
    assert names == RESULTS.keys()


def drawn() -> tuple[int, list[tuple[str, int]]]:
    """A seed, and every result in random order, each with one of its members."""
    seed = secrets.randbits(32)
    rng = np.random.default_rng(seed)
    names = rng.permutation(list(RESULTS)).tolist()
    return seed, [(name, int(rng.integers(count_of(RESULTS[name][0])))) for name in names]


def test_heads_drawn_at_random_recompute():
    seed, order = drawn()
    for name, member in order[:HEADS]:
        wrong = check_heads(*RESULTS[name], members=[member]).wrong
        assert wrong == [], f"{name} drawn with seed {seed}"


def test_whole_runs_drawn_at_random_recompute(monkeypatch):
    monkeypatch.setattr(schedule, "BATCH", 10)  # as they were computed
    seed, order = drawn()
    left = float(WHOLE_SECONDS)
    for name, member in order:
        seconds = expected_seconds(*RESULTS[name], member)
        if seconds <= min(LONGEST, left):
            left -= seconds
            wrong = check_runs(*RESULTS[name], [member]).wrong
            assert not wrong, f"{name} drawn with seed {seed}: {wrong}"


def test_what_was_recomputed_is_noted_of_results_that_are_stored():
    lines = recorded(list(RESULTS.values()))
    assert all(0 <= int(x["member"]) < count_of(RESULTS[x["result"]][0]) for x in lines)
