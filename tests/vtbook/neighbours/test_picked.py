"""The best source is found by trials, and from then on fine-tuned."""

import pytest
import torch

from vtbook.neighbours import PickedSettings
from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.qfunctions import MLP, greedy
from vtlib.replay import Transition
from vtlib.rng import Rng

Q = MLP((2, 4, 2))
DDQN = DDQNSettings(epsilon_steps=1, epsilon_start=0.0, epsilon_end=0.0, minibatch=4)
MELLOW = MellowTDSettings(epsilon_steps=1, epsilon_start=0.0, epsilon_end=0.0, minibatch=4)


def played(settings, episodes=5, pays=lambda episode: episode == 1):
    """Weights (R, d) before each of some episodes of three steps, the sources, and the agent."""
    g = torch.Generator().manual_seed(3)
    sources = torch.randn(2, 3, Q.d, generator=g)
    agent = settings.agent(Q, sources, 2, Rng("picked", [0, 1]))
    weights = []
    for episode in range(episodes):
        for step in range(3):
            obs, after = torch.randn(2, 2, 2, generator=g)
            action = agent.act(obs, torch.full((2,), step == 0))
            if step == 0:
                weights.append(agent.mu[:, 0].clone())
                assert torch.equal(action, greedy(Q, agent.mu, obs))
            reward = torch.full((2,), float(pays(episode)))
            agent.learn(Transition(obs, action, reward, after, torch.zeros(2).bool()))
    return torch.stack(weights), sources, agent


@pytest.mark.parametrize("learner", [DDQN, MELLOW])
def test_sources_are_tried_in_turn_and_the_best_is_where_learning_starts(learner):
    weights, sources, _ = played(PickedSettings(learner))
    for episode in range(3):
        assert torch.equal(weights[episode], sources[:, episode])
    assert torch.equal(weights[3], sources[:, 1])  # the only one that earned anything
    moved = (weights[4] - weights[3]).abs().amax()
    assert 0 < moved < 3 * 3 * learner.alpha  # three of Adam's steps, whose moments begin at zero


def test_ddqn_values_by_the_best_source_and_not_by_the_first():
    _, sources, agent = played(PickedSettings(DDQN), episodes=3)
    agent.act(torch.zeros(2, 2), torch.tensor([True, True]))
    assert torch.equal(agent._learner._target[:, 0], sources[:, 1])


def test_a_run_begins_when_its_own_trials_end():
    g = torch.Generator().manual_seed(3)
    sources = torch.randn(2, 2, Q.d, generator=g)
    agent = PickedSettings(MELLOW).agent(Q, sources, 2, Rng("picked", [0, 1]))
    obs = torch.zeros(2, 2)
    for fresh in ([True, True], [True, False], [True, False]):
        agent.act(obs, torch.tensor(fresh))
        step = Transition(obs, torch.zeros(2).long(), torch.ones(2), obs, torch.ones(2).bool())
        agent.learn(step)
    assert not torch.equal(agent.mu[0, 0], sources[0, 0])  # it learns
    assert torch.equal(agent.mu[1, 0], sources[1, 0])  # it still tries the first source
