"""Every source may play, and soon the one that earns most plays nearly always."""

import torch

from vtbook.neighbours.reused import Reused, ReusedSettings
from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.rng import Rng

EPISODES, Q = 60, MLP((1, 2, 2))


def played(runs, fresh_of):
    """The source of each step of each run; the second earns more than the third, but later."""
    obs, sources = torch.zeros(len(runs), 1), torch.arange(3.0).view(1, 3, 1)
    sources = sources.expand(len(runs), 3, Q.d).contiguous()
    agent = ReusedSettings(gamma=0.5).agent(Q, sources, 1, Rng("reused", runs))
    assert isinstance(agent, Reused)
    seen = []
    for step in range(2 * EPISODES):
        agent.act(obs, fresh_of(step))
        seen.append(agent.mu[:, 0, 0].clone())
        late = step % 2  # discounted, what is earned in an episode's second step counts half
        reward = torch.tensor([0.0, 1.2 * late, 1.0 - late])[seen[-1].long()]
        agent.learn(Transition(obs, torch.zeros(len(runs)), reward, obs, torch.zeros(len(runs))))
    return torch.stack(seen, 1)


def test_the_source_that_earns_most_soon_plays_and_sources_change_between_episodes_alone():
    every_other = torch.tensor([True, True])
    seen = played([0, 1], lambda step: every_other & (step % 2 == 0))
    assert (seen[:, ::2] == seen[:, 1::2]).all()
    assert (seen[:, :20].unique() == torch.arange(3.0)).all()
    assert ((seen[:, EPISODES:] == 2).float().mean(1) > 0.9).all()


def test_a_run_does_not_depend_on_its_neighbour():
    alone = played([1], lambda step: torch.tensor([step % 2 == 0]))
    beside = played([0, 1], lambda step: torch.tensor([step % 4 == 0, step % 2 == 0]))
    assert torch.equal(beside[1], alone[0])
