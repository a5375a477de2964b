"""Each source plays its trials in turn, and the one that earned most plays on."""

import torch

from vtbook.neighbours.untouched import Untouched, UntouchedSettings
from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.rng import Rng


def test_each_source_is_tried_and_the_best_plays_on():
    q, obs = MLP((1, 2, 2)), torch.zeros(2, 1)
    sources = torch.arange(6.0).view(2, 3, 1).expand(2, 3, q.d).contiguous()
    agent = UntouchedSettings(trials=2, gamma=0.5).agent(q, sources, 1, Rng("untouched", [0, 1]))
    assert isinstance(agent, Untouched)
    # Discounted, the second source of the first run and the last of the second earn most.
    rewards = torch.tensor([[1.0, 1.2, 0.0], [0.5, -2.0, 0.6]]), torch.tensor([[0.3], [0.0]])
    played = []
    for episode in range(9):
        for step in range(2):
            agent.act(obs, torch.full((2,), step == 0))
            played.append(agent.mu[:, 0, 0].clone())
            source = min(episode // 2, 2)
            reward = rewards[step][:, source if step == 0 else 0]
            if episode >= 6:
                reward = torch.full((2,), 100.0)  # after the trials returns count no more
            agent.learn(Transition(obs, torch.zeros(2), reward, obs, torch.zeros(2).bool()))
    first, second = torch.stack(played)[::2].T.tolist()
    assert first == [0, 0, 1, 1, 2, 2, 1, 1, 1]
    assert second == [3, 3, 4, 4, 5, 5, 5, 5, 5]
