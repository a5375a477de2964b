"""Heads: where they start, and whom an episode follows."""

import torch

from vtbook.neighbours import HeadsSettings
from vtlib.qfunctions import MLP
from vtlib.rng import Rng

Q = MLP((2, 3, 2))
RUNS = 2000
EACH = torch.ones(RUNS, dtype=torch.bool)


def normal(*shape):
    return torch.randn(shape, generator=torch.Generator().manual_seed(0))


def test_heads_start_at_the_sources_in_turn_and_one_is_followed_for_an_episode():
    sources = normal(1, 2, Q.d).expand(RUNS, -1, -1)
    agent = HeadsSettings(heads=3).agent(Q, sources, 2, Rng("t", range(RUNS)))
    torch.testing.assert_close(agent.mu, sources[:, [0, 1, 0]])
    followed = agent._acting(EACH)
    torch.testing.assert_close(agent._acting(~EACH), followed)
    counts = torch.bincount(agent._head, minlength=3)
    assert (counts - RUNS / 3).abs().max() < 5 * (RUNS * 2 / 9) ** 0.5
    assert (agent._acting(EACH) != followed).any()
