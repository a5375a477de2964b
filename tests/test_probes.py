"""The probes of an experiment: what they note, at each look, without disturbing the runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from vtlib.coverage import LEVELS
from vtlib.domains import domain, rooms_q
from vtlib.envs.cartpole import CartpoleFamily
from vtlib.envs.rooms import RoomsFamily
from vtlib.experiments import Experiment
from vtlib.experiments.calibration import coverage_figure
from vtlib.experiments.probes import CoverageProbe, StabilityProbe
from vtlib.experiments.runs import prepare, run_batch, targets
from vtlib.mellow import mellowmax
from vtlib.planning import plan
from vtlib.sources import NetworkPool, Pool
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
        assert arrays["inside"].shape == (2, 2, 2, len(LEVELS))
        assert (np.diff(arrays["inside"], axis=3) >= 0).all()
        plain = run_batch(replace(TINY, probes=0), label, [0, 2], WEIGHTS)
        assert "inside" not in plain
        np.testing.assert_array_equal(arrays["learning"], plain["learning"])
        np.testing.assert_array_equal(arrays["greedy"], plain["greedy"])


def test_the_truths_are_the_planned_values_of_each_runs_own_task():
    tasks = targets(TINY, [0, 2])
    probe = CoverageProbe(TINY, [0, 2], tasks, 50.0)
    for row in range(2):
        for which, kappa in enumerate((None, 50.0)):
            values = plan(tasks, row, None, kappa=kappa).q(probe._obs[row])
            expected = values[torch.arange(40), probe._action[row]]
            torch.testing.assert_close(probe._truths[which, row], expected)
    alone = CoverageProbe(TINY, [2], targets(TINY, [2]), 50.0)
    torch.testing.assert_close(alone._obs[0], probe._obs[1])
    assert set(probe._action.flatten().tolist()) == {0, 1, 2, 3}


def test_a_wide_posterior_covers_more_than_a_narrow_one():
    agent = prepare(TINY, "GVT", TINY.algorithms["GVT"], [0], WEIGHTS).agent
    shares = []
    for factor in (1e-3, 1e3):
        probe = CoverageProbe(TINY, [0], targets(TINY, [0]), 100.0)
        agent._factors.L.copy_(factor * torch.eye(rooms_q().d))
        probe.look(agent)
        shares.append(probe.arrays["inside"][0, 0])
    assert (shares[0] < 0.1).all()
    assert (shares[1] > 0.9 * np.array(LEVELS)).all()


def test_the_error_is_that_of_the_posteriors_mean():
    agent = prepare(TINY, "GVT", TINY.algorithms["GVT"], [0, 1], WEIGHTS).agent
    probe = CoverageProbe(TINY, [0, 1], targets(TINY, [0, 1]), 100.0)
    agent._factors.L.copy_(1e-6 * torch.eye(rooms_q().d))
    probe.look(agent)
    values = rooms_q().q(agent.mu.detach(), rooms_q().prepare(probe._obs))[:, 0]
    chosen = values.gather(1, probe._action.unsqueeze(1)).squeeze(1)
    found = probe.arrays
    for which in range(2):
        expected = (chosen - probe._truths[which]).mean(-1)
        np.testing.assert_allclose(found["off"][:, 0, which], expected, atol=1e-4)
    # both errors are of the same mean
    apart = found["off"][:, 0] + found["truth"]
    np.testing.assert_allclose(apart[:, 0], apart[:, 1], rtol=1e-5)


def test_the_figure_has_a_panel_for_each_level_and_a_row_for_each_truth():
    inside = np.random.default_rng(0).random((5, 3, 2, 3))
    figure = coverage_figure({"GVT": {"iterations": np.arange(1, 4), "inside": inside}})
    titles = [ax.get_title("left") for ax in figure.axes]
    assert titles == [f"{level:.0%} intervals" for level in LEVELS] + [""] * 3
    drawn = [ax.get_lines()[0].get_ydata() for ax in figure.axes]
    np.testing.assert_allclose(drawn, inside.mean(0).transpose(1, 2, 0).reshape(6, 3))


POLES = Experiment(
    "tiny-poles",
    NetworkPool("tiny-poles-pool", CartpoleFamily(), count=4),
    CartpoleFamily(),
    {
        "2-MGVT": Settings(components=2, batch=5, weights=2),
        "GVT": Settings("gaussian", batch=5, weights=2, alpha_L=1e-4),
    },
    runs=3,
    sources=3,
    iterations=20,
    every=10,
    probes=30,
)
POLE_Q = domain(CartpoleFamily()).q()
POLE_WEIGHTS = np.random.default_rng(1).standard_normal((4, POLE_Q.d)).astype(np.float32)


@pytest.mark.parametrize("label", POLES.algorithms)
def test_stability_is_stored_at_each_evaluation_and_disturbs_nothing(label):
    arrays = run_batch(POLES, label, [0, 2], POLE_WEIGHTS)
    for name in ("value", "spread", "step"):
        assert arrays[name].shape == (2, 2)
        assert np.isfinite(arrays[name]).all()
    assert (arrays["spread"] > 0).all()
    assert (arrays["step"] > 0).all()
    plain = run_batch(replace(POLES, probes=0), label, [0, 2], POLE_WEIGHTS)
    assert "value" not in plain
    np.testing.assert_array_equal(arrays["learning"], plain["learning"])
    np.testing.assert_array_equal(arrays["greedy"], plain["greedy"])
    alone = run_batch(POLES, label, [2], POLE_WEIGHTS)
    np.testing.assert_allclose(alone["spread"][0], arrays["spread"][1], rtol=1e-4)
    np.testing.assert_allclose(alone["step"][0], arrays["step"][1], rtol=1e-3)


def test_spread_scales_with_the_factor_and_steps_with_their_size():
    noted = []
    for scale in (1.0, 0.01):
        settings = replace(POLES.algorithms["GVT"], alpha_L=1e-4 * scale)
        batch = prepare(POLES, "GVT", settings, [0], POLE_WEIGHTS)
        batch.advance()
        batch.agent._factors.L.copy_(1e-3 * scale * torch.eye(POLE_Q.d))
        probe = StabilityProbe(POLES, [0], settings)
        probe.look(batch.agent)
        noted.append(probe.arrays)
    first, second = noted
    np.testing.assert_allclose(second["spread"], 0.01 * first["spread"], rtol=0.05)
    np.testing.assert_allclose(second["step"], 0.01 * first["step"], rtol=0.05)


def test_the_value_is_the_mean_networks_mellow_value_at_remembered_states():
    settings = POLES.algorithms["GVT"]
    batch = prepare(POLES, "GVT", settings, [0], POLE_WEIGHTS)
    obs = batch.episodes.obs.clone()
    batch.advance()  # one transition is all that it remembers
    probe = StabilityProbe(POLES, [0], settings)
    probe.look(batch.agent)
    values = POLE_Q.q(batch.agent.mu.detach(), POLE_Q.prepare(obs.unsqueeze(1)))
    expected = mellowmax(values[0, 0, :, 0], settings.kappa)
    assert float(probe.arrays["value"][0, 0]) == pytest.approx(float(expected), rel=1e-5)
