"""Trust whose sources never play plays what it learns from the first episode on."""

import torch

from vtbook.neighbours import VariedTrust
from vtlib.qfunctions import MLP, greedy
from vtlib.replay import Transition
from vtlib.rng import Rng


def test_sources_never_play_and_what_is_learned_starts_at_their_mean():
    q, g = MLP((2, 4, 2)), torch.Generator().manual_seed(1)
    sources = torch.randn(2, 3, q.d, generator=g)
    agent = VariedTrust(alone=True, random=0.0).agent(q, sources, 2, Rng("alone", [0, 1]))
    mean, end = sources.mean(1, keepdim=True), torch.ones(2, dtype=torch.bool)
    torch.testing.assert_close(agent.mu, mean)
    for episode in range(40):
        obs = torch.randn(2, 2, generator=g)
        action = agent.act(obs, end)
        if episode == 0:
            assert torch.equal(action, greedy(q, mean, obs))
        # the sources would keep any promise: all returns are huge
        agent.learn(Transition(obs, action, torch.full((2,), 1e6), obs, end))
    played = agent.state()["played"]
    assert played.shape == (2, 39)
    assert (played == 3).all()
