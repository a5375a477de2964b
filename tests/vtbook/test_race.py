"""The race of the first page: two runs as they went, told to the page in few bytes."""

from __future__ import annotations

import json
import re
from base64 import b64decode

import numpy as np
import pytest
from bs4 import BeautifulSoup

from vtbook import race, visits
from vtbook.experiments.rooms import ROOMS_EVALUATION
from vtlib.experiments.run import prepare, targets
from vtlib.experiments.store import weights

HERE = ROOMS_EVALUATION.published
SHOWN, ITERATIONS, RUN = {"NT": "left", "1-MGVT": "right"}, 600, 1


@pytest.fixture(scope="module")
def visited() -> np.ndarray:
    return race.paths(HERE, list(SHOWN), ITERATIONS, RUN)


@pytest.fixture(scope="module")
def page() -> BeautifulSoup:
    return BeautifulSoup(race.race(HERE, SHOWN, ITERATIONS, RUN), "html.parser")


def test_paths_are_those_of_the_runs_one_at_a_time(visited):
    for label, path in zip(SHOWN, visited, strict=True):
        batch = prepare(race.evolve(HERE, visits=True), label, [RUN], weights(HERE.pool))
        for _ in batch.moments([200]):
            np.testing.assert_allclose(path[:200], batch.episodes.visited[0], atol=1e-5)


def test_the_page_is_told_where_each_agent_was_and_when_it_arrived(page, visited):
    setup = json.loads(page.select_one("script[type='application/json']").string)
    tasks = targets(HERE, [RUN])
    np.testing.assert_allclose(setup["doors"], tasks.doors[0], atol=1e-3)
    np.testing.assert_allclose(setup["walls"], tasks.walls, atol=1e-3)
    for told, path in zip(setup["runs"], visited, strict=True):
        places = np.frombuffer(b64decode(told["places"]), np.uint8).reshape(-1, 2)
        assert np.abs(places / race.STEPS * setup["side"] - path).max() <= 0.51 * 10 / race.STEPS
        assert len(told["reached"]) == visits.arrivals(path[None])[0]
        assert all(visits.at_goal(path[t - 1]) for t in told["reached"])


def test_who_cannot_see_it_move_is_told_how_it_ends(page, visited):
    squares = page.select_one(".squares")
    counts = visits.arrivals(visited)
    assert squares["role"] == "img"
    assert re.findall(r"(\w+): (\d+) times", squares["aria-label"]) == [
        (name, str(count)) for name, count in zip(SHOWN.values(), counts, strict=True)
    ]
    assert page.select_one("input")["aria-label"]
    assert len(str(page)) < 60_000
