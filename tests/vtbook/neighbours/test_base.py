"""What every neighbour keeps: runs alone as in a batch, sources as they were, refusals."""

import pytest
import torch

from vtbook import neighbours
from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.rng import Rng

Q = MLP((2, 3, 2))
SOURCES = torch.randn(3, 4, Q.d, generator=torch.Generator().manual_seed(0))
KINDS = [
    neighbours.LangevinSettings(lambda_=1e-3),
    neighbours.RepeatedSettings(neighbours.LangevinSettings(lambda_=1e-3), 2),
    neighbours.UnstartedSettings(components=2, n_samples=2),
]


def learned(settings, rows):
    """The weights and actions of some of the runs, on transitions of their own."""
    agent = settings.agent(Q, SOURCES[rows], 2, Rng("t", rows))
    world, actions = torch.Generator().manual_seed(1), []
    for t in range(8):
        obs, reward = torch.rand(2, 3, 2, generator=world), torch.rand(3, generator=world)
        fresh, done = (torch.full((len(rows),), t % 4 == at) for at in (0, 3))
        actions.append(agent.act(obs[0, rows], fresh))
        agent.learn(Transition(obs[0, rows], actions[-1], reward[rows], obs[1, rows], done))
    return agent.mu, torch.stack(actions)


@pytest.mark.parametrize("settings", KINDS)
def test_a_run_depends_on_no_other_in_the_batch_and_leaves_sources_alone(settings):
    before = SOURCES.clone()
    together, taken = learned(settings, [0, 1, 2])
    for row in range(3):
        alone, own = learned(settings, [row])
        torch.testing.assert_close(alone[0], together[row], rtol=1e-4, atol=1e-5)
        torch.testing.assert_close(own[:, 0], taken[:, row])
    torch.testing.assert_close(SOURCES, before, rtol=0, atol=0)
    assert not torch.equal(together[:, 0], SOURCES.mean(1))


@pytest.mark.parametrize("settings", KINDS)
def test_wrong_sources_are_refused(settings):
    with pytest.raises(ValueError, match="finite"):
        settings.agent(Q, torch.nan * SOURCES, 2, Rng("t", range(3)))
