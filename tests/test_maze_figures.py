"""The maze page's figures: walks that begin alike, end at the goal, and follow the policy."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import torch

from vtlib.baselines import DDQNSettings
from vtlib.envs.maze import MazeFamily, Mazes
from vtlib.experiments import Experiment
from vtlib.experiments.maze_figures import (
    STARTS,
    beliefs_on_the_way,
    gallery,
    returns_grid,
    returns_table,
    targets_figure,
    walk,
    walks_on_the_way,
    walks_picture,
)
from vtlib.experiments.mazes import (
    CORNERS,
    DIAGONAL,
    MAZE_SLIDERS,
    MAZE_TARGETS,
    MAZES,
)
from vtlib.experiments.reading import returns
from vtlib.experiments.runs import chosen_sources, targets
from vtlib.sources import MazePool
from vtlib.transfer import Settings

TINY = Experiment(
    "tiny",
    MazePool("tiny-pool", MazeFamily(), count=20),
    MazeFamily(("north-east 1",)),
    {
        "2-MGVT": Settings(components=2, batch=5, weights=2, alpha_L=1e-6),
        "DDQN": DDQNSettings(epsilon_steps=10, batch=5, target_every=7),
    },
    runs=2,
    sources=3,
    iterations=20,
    every=10,
    excluded=(0, 1, 2, 3, 4),
)
WEIGHTS = (0.1 * np.random.default_rng(0).standard_normal((20, 1891))).astype(np.float32)


def ahead(states: torch.Tensor) -> torch.Tensor:
    return torch.zeros(len(states), dtype=torch.int64)


def test_targets_are_the_third_of_each_corner_and_sources_of_the_others():
    for corner, experiment in MAZE_TARGETS.items():
        assert experiment.family.names == (f"{corner} 3",)
        drawn = np.unique(chosen_sources(experiment, range(experiment.runs)))
        names = [MAZES.family.names[i] for i in drawn]
        assert len(names) == 15
        assert not any(name.startswith(corner) for name in names)
        full, diagonal = (experiment.algorithms[x] for x in ("1-MGVT", DIAGONAL))
        assert replace(diagonal, covariance="full") == full
    assert len(MAZE_TARGETS) == len(CORNERS)
    assert MAZE_TARGETS["north-east"].algorithms["1-MGVT"] in MAZE_SLIDERS.algorithms.values()


def test_walks_of_one_name_begin_alike_and_stay_in_the_maze():
    tasks = Mazes.of(["north-east 1"])
    on, turning = walk(tasks, "a", ahead), walk(tasks, "a", lambda s: ahead(s) + 1)
    assert len(on) == len(turning) == STARTS
    for one, other in zip(on, turning, strict=True):
        np.testing.assert_array_equal(one.states[0], other.states[0])
        cells = np.floor(one.states[:, :2]).astype(int)
        assert not tasks.walls[0].numpy()[tuple(cells.T)].any()
        # who only turns does not get far; the noise moves it by 5 cm a step
        assert np.ptp(other.states[:, :2], 0).max() < 3
    assert not np.array_equal(walk(tasks, "b", ahead)[0].states[0], on[0].states[0])


def test_a_walk_ends_where_it_first_arrives():
    tasks = Mazes.of(["north-east 1"])

    def towards(states: torch.Tensor) -> torch.Tensor:
        bearing = torch.atan2(9.5 - states[:, 1], 9.5 - states[:, 0]) - states[:, 2]
        bearing = torch.remainder(bearing + torch.pi, 2 * torch.pi) - torch.pi
        turn = torch.where(bearing > 0, 1, 2)
        return torch.where(bearing.abs() < 0.3, 0, turn)

    walks = walk(tasks, "a", towards)
    assert sum(one.arrived for one in walks) >= STARTS // 2
    for one in walks:
        at_goal = (np.floor(one.states[:, :2]) == 9).all(1)
        assert list(np.flatnonzero(at_goal)) == ([len(one.states) - 1] if one.arrived else [])


@pytest.mark.parametrize("label", TINY.algorithms)
def test_walks_follow_the_mean_q_function_on_the_way(label):
    at = (0, 3)
    first, later = walks_on_the_way(TINY, label, 1, WEIGHTS, at)
    np.testing.assert_array_equal(first[0].states[0], later[0].states[0])
    assert {len(w.states) for w in first if not w.arrived} <= {Mazes.horizon + 1}
    picture = walks_picture(TINY, {label: [first, later]}, at, 1)
    assert "after 3 iterations" in picture
    assert f"{label}: {sum(w.arrived for w in later)} of {STARTS} robots" in picture


def test_the_gallery_names_every_maze_with_its_optimum():
    values = np.linspace(0.5, 0.9, 20)
    titles = [ax.get_title("left") for ax in gallery(values).axes]
    assert titles == [f"{n}: {v:.2f}" for n, v in zip(MAZES.family.names, values, strict=True)]


def test_the_targets_are_drawn_with_a_robot_each():
    figure = targets_figure({"north-east": TINY})
    assert [ax.get_title("left") for ax in figure.axes] == ["north-east 1"]
    assert len(figure.axes[0].lines) > 2 * STARTS
    assert len(targets(TINY, [0, 1])) == 2


def test_beliefs_are_those_of_the_run_at_that_moment():
    short, longer = (beliefs_on_the_way(TINY, "2-MGVT", 1, WEIGHTS, at) for at in ([5], [5, 10]))
    assert short[0] == longer[0] != longer[1]
    assert np.isfinite(short).all()
    spreads = []
    for variance in (1e-5, 1e-8):
        settings = replace(TINY.algorithms["2-MGVT"], components=1, sigma_p2=variance)
        narrower = replace(TINY, algorithms={"1-MGVT": settings})
        spreads.append(beliefs_on_the_way(narrower, "1-MGVT", 1, WEIGHTS, [2])[0][1])
    assert 0 < spreads[1] < 0.1 * spreads[0]


LABELS = ["DDQN", "GVT", "1-MGVT", "3-MGVT"]


def test_returns_are_drawn_and_tabled():
    figure = returns_grid(MAZE_TARGETS, LABELS)
    lines = re.findall(r"<tr>(.*?)</tr>", returns_table(MAZE_TARGETS, LABELS))
    head, *rows = [re.findall(r"<t[hd]>(.*?)</t[hd]>", line) for line in lines]
    assert head == ["maze", *LABELS]
    for cells, left, (corner, experiment) in zip(
        rows, figure.axes[::2], MAZE_TARGETS.items(), strict=True
    ):
        assert left.get_legend_handles_labels()[1] == [*LABELS, "planned optimum"]
        assert cells[0] == f"{corner} 3"
        for label, cell in zip(LABELS, cells[1:], strict=True):
            runs = returns(experiment.name, label)
            share = (runs.learning.mean(1) / runs.optimum).mean()
            assert cell == f"{share:.0%} / {(runs.greedy[:, -1] / runs.optimum).mean():.0%}"
