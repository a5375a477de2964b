"""Robots in a maze: where they go is recorded without disturbing a run, and told to the page."""

import json
import zlib
from base64 import b64decode

import numpy as np
import pytest
import torch
from attrs import evolve

from vtbook.experiments.maze import MAIN, MAZE_NOTHING, MAZE_TARGETS, MAZE_WALKS
from vtbook.maze_walks import PER_METRE, by_sources, driven, maze_of, six_walks, walks_panel
from vtlab.run import chosen_sources, run_batch
from vtlab.store import load

bs4 = pytest.importorskip("bs4")
HERE = MAZE_WALKS[MAIN]
D = HERE.family.q().d


@pytest.fixture(scope="module")
def weights():
    """Sources that nobody has solved."""
    return 0.1 * np.random.default_rng(0).standard_normal((20, D), dtype=np.float32)


def alone(w):
    """Six walks that are all greedy in weights (d,)."""
    q, maze = HERE.family.q(), maze_of(HERE)

    def greedy(states):
        obs = maze.select([0] * len(states)).observe(states)
        return q.q(w.view(1, 1, -1), q.prepare(obs[None]))[0, 0].argmax(0)

    return six_walks(HERE, greedy)


def test_each_robot_obeys_its_own_weights(weights):
    six = torch.from_numpy(weights[:6])
    places = driven(HERE, six)
    for robot in range(6):
        walk = alone(six[robot])[robot]
        told = places[robot, : len(walk)]
        assert np.abs((told[:, :2] + 0.5) / PER_METRE - walk[:, :2]).max() <= 0.501 / PER_METRE
        np.testing.assert_array_equal(told[:, :2] // PER_METRE, walk[:, :2].astype(int))
        turned = (told[:, 2] + 0.5) * (2 * np.pi / 256) - walk[:, 2]
        assert np.abs(np.angle(np.exp(1j * turned))).max() < 0.02
        assert (places[robot, len(walk) :] == told[-1]).all()


def test_the_sources_drive_in_turn(weights):
    chosen = weights[chosen_sources(HERE, [0])[0]]
    expected = driven(HERE, torch.from_numpy(chosen[[0, 1, 2, 3, 4, 0]]))
    np.testing.assert_array_equal(by_sources(HERE, weights), expected)


@pytest.mark.parametrize(("label", "modes"), [("NT", 1), ("3-MGVT", 2)])
def test_looking_disturbs_nothing_and_robots_share_the_components(weights, label, modes):
    short = evolve(HERE, iterations=20, every=10)
    seen = run_batch(short, label, [0], weights)
    plain = run_batch(evolve(short, probes=0, probe=None), label, [0], weights)
    assert seen.pop("walks").shape == (1, 2, modes, 6, 101, 3)
    for key, array in plain.items():
        np.testing.assert_array_equal(seen[key], array)


@pytest.mark.parametrize("number", MAZE_WALKS)
def test_the_recorded_runs_are_the_first_of_the_stored_ones(number):
    here, published = MAZE_WALKS[number], MAZE_TARGETS[number]
    for label in here.algorithms:
        owner = published if label in published.algorithms else MAZE_NOTHING[number]
        first, again = load(owner, label), load(here, label)
        np.testing.assert_allclose(
            again.fingerprints.values[0], first.fingerprints.values[0], rtol=1e-4, atol=1e-4
        )


def test_the_page_is_told_the_walks_and_the_maze(weights):
    walks = np.random.default_rng(1).integers(0, 250, (10, 2, 6, 101, 3)).astype(np.uint8)
    html = walks_panel({"here": HERE}, {"here": {"GVT": walks}}, {"NT": "none", "GVT": "one"})
    page = bs4.BeautifulSoup(html, "html.parser")
    setup = json.loads(page.select_one("script[type='application/json']").string)
    (maze,) = setup["mazes"]
    walls = np.zeros((10, 10), bool)
    walls[tuple(np.transpose(maze["walls"]))] = True
    np.testing.assert_array_equal(walls, maze_of(HERE).walls[0])
    nothing, run = maze["runs"]
    assert nothing is None
    changes = np.frombuffer(zlib.decompress(b64decode(run["walks"])), np.uint8)
    np.testing.assert_array_equal(np.cumsum(changes.reshape(walks.shape), -2, np.uint8), walks)
    assert int(page.select_one("input")["max"]) == 10 * 101 - 1
    assert [x.text for x in page.select("figcaption")] == ["none", "one"]
