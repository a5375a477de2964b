"""The probes of an experiment: what they note, at each look, without disturbing the runs."""

import numpy as np
import pytest
import torch
from attrs import evolve

from vtbook.credible_intervals import LEVELS, values_at
from vtbook.probes import CoverageProbe
from vtlab.envs.rooms import RoomsFamily, plan
from vtlab.experiment import Pool
from vtlab.run import prepare, run_batch, targets

FAMILY = RoomsFamily(rooms=2)
Q = FAMILY.q()
WEIGHTS = np.random.default_rng(0).standard_normal((3, Q.d)).astype(np.float32)
COVERED = {"inside": (2, 2, 2, len(LEVELS)), "off": (2, 2, 2), "truth": (2, 2)}


@pytest.fixture(scope="module", autouse=True)
def coarse():
    """Plan on a coarse grid: the probes take any plan for the truth."""
    with pytest.MonkeyPatch.context() as patch:
        yield patch.setattr(plan, "SPACING", 1.0)


@pytest.fixture(scope="module")
def rooms(tiny):
    """Short runs in rooms, looked at twice."""
    # left to torch, whose factors can be set
    algorithms = {x: evolve(tiny.algorithms[x], covariance="dense") for x in ("2-MGVT", "GVT")}
    algorithms["GVT"] = evolve(algorithms["GVT"], kappa=50.0)
    short = {"iterations": 20, "every": 10, "probes": 40, "probe": CoverageProbe}
    pool = Pool("rooms", FAMILY, count=3)
    return evolve(tiny, pool=pool, family=FAMILY, algorithms=algorithms, **short)


@pytest.fixture
def probe(rooms):
    return CoverageProbe(rooms, "GVT", [0, 2], targets(rooms, [0, 2]))


def scaled(agent, factor):
    """The agent with a posterior that is as wide as that in all directions."""
    agent._posterior._L.copy_(factor * torch.eye(agent.mu.shape[-1]))
    return agent


@pytest.mark.parametrize("label", ["2-MGVT", "GVT"])
def test_looking_disturbs_nothing(rooms, label):
    arrays = run_batch(rooms, label, [0, 2], WEIGHTS)
    plain = run_batch(evolve(rooms, probes=0, probe=None), label, [0, 2], WEIGHTS)
    assert {key: arrays[key].shape for key in arrays.keys() - plain.keys()} == COVERED
    for key in plain:
        np.testing.assert_array_equal(arrays[key], plain[key])
    assert all(np.isfinite(arrays[key]).all() for key in COVERED)
    alone = run_batch(rooms, label, [2], WEIGHTS)
    for key in COVERED.keys() - {"inside"}:
        np.testing.assert_allclose(alone[key][0], arrays[key][1], rtol=1e-3, atol=1e-4)


def test_a_wide_posterior_covers_more_than_a_narrow_one_which_errs_as_its_mean(rooms, probe):
    agent = prepare(rooms, "GVT", [0, 2], WEIGHTS).agent
    for factor in (1e-6, 1e3):
        probe.look(scaled(agent, factor))
    narrow, wide = probe.arrays["inside"].swapaxes(0, 1)
    assert (np.diff(wide) >= 0).all()
    assert (narrow < 0.1).all()
    assert (wide > 0.9 * np.array(LEVELS)).all()
    values = values_at(Q, agent.mu.detach(), probe._obs, probe._action)[:, 0]
    expected = (values - probe._truths).mean(-1).T
    np.testing.assert_allclose(probe.arrays["off"][:, 0], expected, atol=1e-4)
