"""The stored results of the book: complete, small, of the present configuration, recomputable."""

import secrets

import numpy as np
import pytest

from vtbook.experiments import EXPERIMENTS, POOLS
from vtlab.store import load, results_behind, results_folder
from vtlab.units import expected_seconds
from vtlab.verify import check, count_of

ROOT = results_folder()
RESULTS = {f"{o.name}/{label}": (o, label) for o, label in results_behind(EXPERIMENTS.values())}
HEADS, WHOLE_SECONDS, LONGEST = 3, 10, 10  # seconds by the clock of what is stored
# as those that nobody had looked at, and such as show what is lost: most were never rewarded
FEW = {"mountain-car-sources-unchecked", "rooms-3-corner-sources"}


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_result_is_stored_under_the_present_configuration(name):
    for owner, label in results_behind([EXPERIMENTS[name]]):
        for values in load(owner, label).values():
            assert np.isfinite(values).all()


@pytest.mark.parametrize("name", POOLS)
def test_sources_are_solved_or_were_trained_to_the_limit(name):
    pool, sources = POOLS[name], load(POOLS[name], "sources")
    solved, iterations = sources.solved, sources.iterations
    missing = sources.optimum - sources.greedy
    enough = missing <= (1 - pool.required) * np.abs(sources.optimum) + 1e-6
    assert enough[solved].all()
    assert (iterations[~solved] <= pool.limit * pool.attempts).all()
    if name in FEW:
        assert (iterations == pool.iterations).all()
        assert 0 < solved.mean() < 0.5
    else:
        assert solved.mean() > 0.5


def test_nothing_stored_is_stray_and_all_of_it_small():
    stored = (path.relative_to(ROOT).as_posix() for path in ROOT.rglob("*.json"))
    names = {name.removesuffix(".json") for name in stored if not name.startswith("guide/")}
    assert names == RESULTS.keys()
    assert sum(path.stat().st_size for path in ROOT.rglob("*") if path.is_file()) < 30e6


def test_members_drawn_at_random_recompute():
    seed = secrets.randbits(32)
    rng, left = np.random.default_rng(seed), float(WHOLE_SECONDS)
    for place, name in enumerate(rng.permutation(list(RESULTS)).tolist()):
        owner, label = RESULTS[name]
        member = int(rng.integers(count_of(owner)))
        told = f"member {member} of {name}, drawn with seed {seed}"
        if place < HEADS:
            assert check(owner, label, [member], quick=True).same, told
        seconds = expected_seconds(owner, label, member)
        if seconds <= min(LONGEST, left):
            left -= seconds
            found = check(owner, label, [member])
            assert found.same, f"{told}: {found.said}"
