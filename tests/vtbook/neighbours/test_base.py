"""What every neighbour keeps: runs alone as in a batch, refusals, no epsilon."""

from __future__ import annotations

import attrs
import pytest
import torch

from vtbook.neighbours import (
    HeadsSettings,
    HierarchicalSettings,
    IVONSettings,
    LangevinSettings,
    RegressionSettings,
)
from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.rng import Rng

Q = MLP((2, 3, 2))
SOURCES = torch.randn(3, 4, Q.d, generator=torch.Generator().manual_seed(0))
KINDS = [
    HeadsSettings(heads=3),
    HeadsSettings(heads=3, prior_scale=2.0),
    LangevinSettings(lambda_=1e-3, prior="gaussian"),
    LangevinSettings(lambda_=1e-3),
    IVONSettings(lambda_=1e-3, n_samples=2),
    RegressionSettings(every=3),
    HierarchicalSettings(family="gaussian", n_samples=2),
]


def learned(settings, rows, steps=8):
    """The weights and actions of some of the runs, on transitions of their own."""
    agent = settings.agent(Q, SOURCES[rows], 2, Rng("t", rows))
    world, actions = torch.Generator().manual_seed(1), []
    for t in range(steps):
        obs, reward = torch.rand(2, 3, 2, generator=world), torch.rand(3, generator=world)
        fresh = torch.full((len(rows),), t % 4 == 0)
        action = agent.act(obs[0, rows], fresh)
        assert action.shape == (len(rows),)
        done = torch.full((len(rows),), t % 4 == 3)
        agent.learn(Transition(obs[0, rows], action, reward[rows], obs[1, rows], done))
        actions.append(action)
    return agent.mu, torch.stack(actions)


@pytest.mark.parametrize("settings", KINDS)
def test_a_run_does_not_depend_on_its_neighbours_in_the_batch(settings):
    together, taken = learned(settings, [0, 1, 2])
    for row in range(3):
        alone, own = learned(settings, [row])
        torch.testing.assert_close(alone[0], together[row], rtol=1e-4, atol=1e-5)
        torch.testing.assert_close(own[:, 0], taken[:, row])


@pytest.mark.parametrize("settings", KINDS)
def test_sources_are_left_alone_and_wrong_ones_refused(settings):
    before = SOURCES.clone()
    weights, _ = learned(settings, [0, 1, 2])
    torch.testing.assert_close(SOURCES, before, rtol=0, atol=0)
    assert weights.isfinite().all()
    assert not torch.equal(weights[:, 0], SOURCES.mean(1))
    rng = Rng("t", range(3))
    wrong = SOURCES.clone()
    wrong[1, 2, 3] = torch.nan
    for bad, words in (
        (wrong, "finite"),
        (SOURCES[:, :0], "at least 1 source"),
        (SOURCES[..., 1:], "shape"),
        (SOURCES.double(), "float32"),
        (SOURCES[:2], "each of 3 runs"),
    ):
        with pytest.raises(ValueError, match=words):
            settings.agent(Q, bad, 2, rng)


@pytest.mark.parametrize("settings", KINDS)
def test_they_are_stored_beside_their_results_and_explore_by_their_posterior_alone(settings):
    assert attrs.has(type(settings))
    assert settings.transfers
    assert not [x for x in attrs.asdict(settings) if "epsilon" in x]
