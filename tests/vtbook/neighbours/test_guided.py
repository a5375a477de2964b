"""A learner that is shown what sources do: they act first, and it takes none of their weights."""

import torch

from vtbook.neighbours import GuidedSettings
from vtlib.baselines import MellowTDSettings
from vtlib.qfunctions import MLP, greedy
from vtlib.replay import Transition
from vtlib.rng import Rng

Q, RUNS = MLP((2, 4, 3)), 40
SOURCES = torch.randn(RUNS, 2, Q.d, generator=torch.Generator().manual_seed(1))


def test_sources_act_in_turn_and_then_the_learner_which_has_learned_meanwhile():
    learner = MellowTDSettings(epsilon_steps=1, epsilon_start=0.0, epsilon_end=0.0, alpha=0.1)
    agent = GuidedSettings(learner, episodes=3).agent(Q, SOURCES, 2, Rng("guided", range(RUNS)))
    world, first = torch.Generator().manual_seed(2), agent.mu.clone()
    assert first.std() < 0.15  # random weights of the given scale, not the sources' of 1
    for episode in range(5):
        for step in range(2):
            obs = torch.rand(RUNS, 2, generator=world)
            shown = SOURCES[:, episode % 2].unsqueeze(1) if episode < 3 else agent.mu
            expected = greedy(Q, shown, obs)
            action = agent.act(obs, torch.full((RUNS,), step == 0))
            assert torch.equal(action, expected)
            ends = torch.full((RUNS,), step == 1)
            agent.learn(Transition(obs, action, torch.ones(RUNS), obs, ends))
        if episode == 2:
            assert not torch.equal(agent.mu, first)
