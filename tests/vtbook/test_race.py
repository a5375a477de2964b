"""The race of the first page: two runs as they went, told to the page in few bytes."""

import json
import re
from base64 import b64decode
from unittest.mock import Mock

import numpy as np
import pytest

from vtbook import race, visits
from vtbook.experiments.rooms import ROOMS_EVALUATION
from vtlab.run import targets

bs4 = pytest.importorskip("bs4")
HERE = ROOMS_EVALUATION
SHOWN, RUN = {"NT": "left", "1-MGVT": "right"}, 1


def test_the_page_is_told_where_each_agent_was_and_how_often_it_arrived(monkeypatch):
    visited = np.random.default_rng(0).uniform(0, 10, (2, 600, 2))
    paths = Mock(return_value=visited)
    monkeypatch.setattr(race, "paths", paths)
    page = bs4.BeautifulSoup(race.race(HERE, SHOWN, 600, RUN), "html.parser")
    paths.assert_called_once_with(HERE, list(SHOWN), 600, RUN)
    setup = json.loads(page.select_one("script[type='application/json']").string)
    tasks, counts = targets(HERE, [RUN]), visits.arrivals(visited)
    assert counts.min() > 0
    np.testing.assert_allclose(setup["doors"], tasks.doors[0], atol=1e-3)
    np.testing.assert_allclose(setup["walls"], tasks.walls, atol=1e-3)
    for told, path, count in zip(setup["runs"], visited, counts, strict=True):
        places = np.frombuffer(b64decode(told["places"]), np.uint8).reshape(-1, 2)
        assert np.abs(places / race.STEPS * setup["side"] - path).max() <= 0.51 * 10 / race.STEPS
        assert len(told["reached"]) == count
        assert all(visits.at_goal(path[t - 1]) for t in told["reached"])
    said = re.findall(r"(\w+): (\d+) times", page.select_one(".squares")["aria-label"])
    assert said == list(zip(SHOWN.values(), map(str, counts), strict=True))
    assert len(str(page)) < 60_000
