"""Variational transfer in units of its sources: alike in any, and silent at first."""

import pytest
import torch
from attrs import evolve
from torch import nn

from vtlib.qfunctions import ModuleQ
from vtlib.replay import Transition
from vtlib.rng import Rng
from vtlib.trust import NARROW, Trust
from vtlib.units import FIRST, InUnits

FEATURES, ACTIONS, RUNS, SOURCES = 4, 2, 2, 3
Q = ModuleQ(nn.Linear(FEATURES, ACTIONS, bias=False), ACTIONS)
SETTINGS = evolve(Trust(components=SOURCES).in_units, init="sources", n_samples=5)
RNG = Rng("units", range(RUNS))


def stream(unit):
    """Transitions of both runs, for ever; observations are in some unit."""
    g = torch.Generator().manual_seed(0)
    while True:
        obs, after = torch.randn(2, RUNS, FEATURES, generator=g) / unit
        action = torch.randint(ACTIONS, (RUNS,), generator=g)
        end = torch.rand(RUNS, generator=g) < 0.1
        yield Transition(obs, action, torch.rand(RUNS, generator=g), after, end)


def learned(steps, unit=1.0, updates=4):
    """An agent after so many transitions, and the actions that it chose on the way."""
    g = torch.Generator().manual_seed(7)
    sources = torch.randn(RUNS, SOURCES, Q.d, generator=g) * unit
    actions = []
    agent = InUnits(Q, sources, FEATURES, SETTINGS, updates, RNG)
    for _, t in zip(range(steps), stream(unit), strict=False):
        actions.append(agent.act(t.obs, torch.zeros(RUNS, dtype=torch.bool)))
        agent.learn(t)
    return agent, actions, sources


def test_weights_in_other_units_are_learned_alike():
    (learner, acts, _), (scaled, same, _) = learned(150), learned(150, unit=100.0)
    acts, same = torch.stack(acts), torch.stack(same)
    assert (acts == same).float().mean() > 0.98  # rounding may turn a tie
    torch.testing.assert_close(scaled.mu, 100 * learner.mu, rtol=1e-3, atol=1e-2)
    torch.testing.assert_close(scaled.scale_tril, 100 * learner.scale_tril)
    unit = learned(0)[2].square().mean((1, 2)).sqrt()
    torch.testing.assert_close(learner.scale_tril[:, 0, 0, 0], NARROW * unit)


def test_it_starts_at_different_sources_and_only_remembers_at_first():
    before, _, sources = learned(FIRST)
    torch.testing.assert_close(before.mu, sources)
    after, _, _ = learned(FIRST + 1)
    assert ((after.mu - sources).abs().amax(-1) > 0).all()


def test_more_updates_go_further():
    far = [(learned(FIRST + 20, updates=n)[0].mu - learned(FIRST)[2]).norm() for n in (1, 4)]
    assert far[1] > 2 * far[0]


@pytest.mark.parametrize("weight", [0, 1e25])
def test_sources_that_are_no_unit_are_refused(weight):
    sources = torch.full((RUNS, SOURCES, Q.d), float(weight))
    with pytest.raises(ValueError, match="neither all zero nor huge"):
        InUnits(Q, sources, FEATURES, SETTINGS, 4, RNG)
