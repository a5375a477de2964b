"""The probes of an experiment: pairs of each run's own, planned values, recorded at each look."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from vtlib.coverage import LEVELS
from vtlib.domains import rooms_q
from vtlib.envs.rooms import RoomsFamily
from vtlib.experiments import Experiment
from vtlib.experiments.calibration import coverage_figure
from vtlib.experiments.probes import CoverageProbe
from vtlib.experiments.runs import prepare, run_batch, targets
from vtlib.planning import plan
from vtlib.sources import Pool
from vtlib.transfer import Settings

TINY = Experiment(
    "tiny",
    Pool("tiny-pool", RoomsFamily(rooms=2), count=4),
    RoomsFamily(rooms=2),
    {
        "2-MGVT": Settings(components=2, batch=5, weights=2),
        "GVT": Settings("gaussian", batch=5, weights=2),
    },
    runs=3,
    sources=3,
    iterations=20,
    every=10,
    probes=40,
)
WEIGHTS = np.random.default_rng(0).standard_normal((4, rooms_q().d)).astype(np.float32)


def test_coverage_is_stored_at_each_evaluation_and_disturbs_nothing():
    for label in TINY.algorithms:
        arrays = run_batch(TINY, label, [0, 2], WEIGHTS)
        assert arrays["inside"].shape == (2, 2, len(LEVELS))
        assert (np.diff(arrays["inside"], axis=2) >= 0).all()
        plain = run_batch(replace(TINY, probes=0), label, [0, 2], WEIGHTS)
        assert "inside" not in plain
        np.testing.assert_array_equal(arrays["learning"], plain["learning"])
        np.testing.assert_array_equal(arrays["greedy"], plain["greedy"])


def test_the_truth_is_the_planned_value_of_each_runs_own_task():
    tasks = targets(TINY, [0, 2])
    probe = CoverageProbe(TINY, [0, 2], tasks)
    for row in range(2):
        values = plan(tasks, row, None).q(probe._obs[row])
        expected = values[torch.arange(40), probe._action[row]]
        torch.testing.assert_close(probe._truth[row], expected)
    alone = CoverageProbe(TINY, [2], targets(TINY, [2]))
    torch.testing.assert_close(alone._obs[0], probe._obs[1])
    assert set(probe._action.flatten().tolist()) == {0, 1, 2, 3}


def test_a_wide_posterior_covers_more_than_a_narrow_one():
    agent = prepare(TINY, "GVT", TINY.algorithms["GVT"], [0], WEIGHTS).agent
    shares = []
    for factor in (1e-3, 1e3):
        probe = CoverageProbe(TINY, [0], targets(TINY, [0]))
        agent._factors.L.copy_(factor * torch.eye(rooms_q().d))
        probe.look(agent)
        shares.append(probe.shares[0, 0])
    assert (shares[0] < 0.1).all()
    assert (shares[1] > 0.9 * np.array(LEVELS)).all()


def test_the_figure_has_a_panel_for_each_level():
    arrays = {"iterations": np.arange(1, 4), "inside": np.random.default_rng(0).random((5, 3, 3))}
    titles = [ax.get_title("left") for ax in coverage_figure({"GVT": arrays}).axes]
    assert titles == [f"{level:.0%} intervals" for level in LEVELS]
