"""The probes of an experiment: what they note, at each look, without disturbing the runs."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from attrs import evolve

from vtbook.coverage import LEVELS
from vtbook.probes import CoverageProbe, StabilityProbe
from vtlib.envs.rooms import RoomsFamily
from vtlib.envs.rooms.plan import plan_rooms
from vtlib.experiments.experiment import Pool
from vtlib.experiments.run import prepare, run_batch, targets
from vtlib.td import mellowmax

Q = RoomsFamily(rooms=2).q()
COVERED = {"inside": (2, 2, 2, len(LEVELS)), "off": (2, 2, 2), "truth": (2, 2), "apart": (2, 2)}
WEIGHTS = np.random.default_rng(0).standard_normal((3, Q.d)).astype(np.float32)


@pytest.fixture
def poles(tiny):
    """Short runs of two cartpoles, looked at twice."""
    # left to torch, whose factors can be set
    transfers = {
        label: evolve(tiny.algorithms[label], covariance="dense") for label in ("2-MGVT", "GVT")
    }
    return evolve(
        tiny,
        algorithms=transfers,
        iterations=20,
        every=10,
        probes=30,
        probe=StabilityProbe,
    )


@pytest.fixture
def rooms(poles):
    """The same in two rooms."""
    family = RoomsFamily(rooms=2)
    algorithms = {
        label: evolve(one, kappa=kappa)
        for (label, one), kappa in zip(poles.algorithms.items(), (100.0, 50.0), strict=True)
    }
    return evolve(
        poles,
        pool=Pool("rooms", family, count=3),
        family=family,
        algorithms=algorithms,
        probes=40,
        probe=CoverageProbe,
    )


def scaled(agent, factor):
    """The agent with a posterior that is as wide as that in all directions."""
    agent._posterior._L.copy_(factor * torch.eye(agent.mu.shape[-1]))
    return agent


@pytest.mark.parametrize("label", ["2-MGVT", "GVT"])
def test_looking_disturbs_nothing(rooms, poles, weights, label):
    for experiment, pool, seen in (
        (rooms, WEIGHTS, COVERED),
        (poles, weights[:3], dict.fromkeys(("value", "spread", "step"), (2, 2))),
    ):
        arrays = run_batch(experiment, label, [0, 2], pool)
        plain = run_batch(evolve(experiment, probes=0, probe=None), label, [0, 2], pool)
        assert {key: arrays[key].shape for key in arrays.keys() - plain.keys()} == seen
        for key in plain:
            np.testing.assert_array_equal(arrays[key], plain[key])
        assert all(np.isfinite(arrays[key]).all() for key in seen)
        alone = run_batch(experiment, label, [2], pool)
        for key in seen.keys() - {"inside"}:
            np.testing.assert_allclose(alone[key][0], arrays[key][1], rtol=1e-3, atol=1e-4)


def test_the_truths_are_the_planned_values_of_each_runs_own_task(rooms):
    tasks = targets(rooms, [0, 2])
    probe = CoverageProbe(rooms, "GVT", [0, 2], tasks)
    for row in range(2):
        for which, kappa in enumerate((None, 50.0)):
            values = plan_rooms(tasks, row, None, kappa).q(probe._obs[row])
            expected = values[torch.arange(40), probe._action[row]]
            torch.testing.assert_close(probe._truths[which, row], expected)
    assert set(probe._action.flatten().tolist()) == {0, 1, 2, 3}


def test_a_wide_posterior_covers_more_than_a_narrow_one(rooms):
    agent = prepare(rooms, "GVT", [0], WEIGHTS).agent
    shares = []
    for factor in (1e-3, 1e3):
        probe = CoverageProbe(rooms, "GVT", [0], targets(rooms, [0]))
        probe.look(scaled(agent, factor))
        shares.append(probe.arrays["inside"][0, 0])
    assert (np.diff(shares[1]) >= 0).all()
    assert (shares[0] < 0.1).all()
    assert (shares[1] > 0.9 * np.array(LEVELS)).all()


def test_the_error_is_that_of_the_posteriors_mean(rooms):
    agent = scaled(prepare(rooms, "GVT", [0, 1], WEIGHTS).agent, 1e-6)
    probe = CoverageProbe(rooms, "GVT", [0, 1], targets(rooms, [0, 1]))
    probe.look(agent)
    values = Q.q(agent.mu.detach(), Q.prepare(probe._obs))[:, 0]
    chosen = values.gather(1, probe._action.unsqueeze(1)).squeeze(1)
    for which in range(2):
        expected = (chosen - probe._truths[which]).mean(-1)
        np.testing.assert_allclose(probe.arrays["off"][:, 0, which], expected, atol=1e-4)


def test_components_are_as_far_apart_as_their_values_deviate(rooms):
    agent = prepare(rooms, "2-MGVT", [0, 1], WEIGHTS).agent
    probe = CoverageProbe(rooms, "2-MGVT", [0, 1], targets(rooms, [0, 1]))
    probe.look(agent)
    for row, weights in enumerate(agent.mu.detach()):
        values = [Q.q(one[None, None], Q.prepare(probe._obs[row][None]))[0, 0] for one in weights]
        chosen = np.stack([v.gather(0, probe._action[row][None])[0].numpy() for v in values])
        # of two numbers: half their distance
        expected = np.abs(chosen[0] - chosen[1]).mean() / 2
        assert probe.arrays["apart"][row, 0] == pytest.approx(expected, rel=1e-4)
    alone = CoverageProbe(rooms, "GVT", [0, 1], targets(rooms, [0, 1]))
    alone.look(prepare(rooms, "GVT", [0, 1], WEIGHTS).agent)
    assert (alone.arrays["apart"] == 0).all()


def test_spread_scales_with_the_factor_and_steps_with_their_size(poles, weights):
    noted = []
    for scale in (1.0, 0.01):
        settings = evolve(poles.algorithms["GVT"], alpha_L=1e-4 * scale)
        changed = evolve(poles, algorithms={"GVT": settings})
        batch = prepare(changed, "GVT", [0], weights[:3])
        list(batch.moments([1]))
        probe = StabilityProbe(changed, "GVT", [0], targets(changed, [0]))
        probe.look(scaled(batch.agent, 1e-3 * scale))
        noted.append(probe.arrays)
    first, second = noted
    assert (first["spread"] > 0).all()
    np.testing.assert_allclose(second["spread"], 0.01 * first["spread"], rtol=0.05)
    np.testing.assert_allclose(second["step"], 0.01 * first["step"], rtol=0.05)


def test_the_value_is_the_mean_networks_mellow_value_at_remembered_states(poles, weights):
    batch = prepare(poles, "GVT", [0], weights[:3])
    obs, q = batch.episodes.obs.clone(), poles.family.q()
    list(batch.moments([1]))  # one transition is all that it remembers
    probe = StabilityProbe(poles, "GVT", [0], targets(poles, [0]))
    probe.look(batch.agent)
    values = q.q(batch.agent.mu.detach(), q.prepare(obs.unsqueeze(1)))
    expected = mellowmax(values[0, 0, :, 0], poles.algorithms["GVT"].kappa)
    assert float(probe.arrays["value"][0, 0]) == pytest.approx(float(expected), rel=1e-5)
