"""The smallest problem: Q(x) = w x + b, of which one transition tells all."""

import pytest
import torch

from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.rng import Rng


@pytest.fixture
def on_a_line():
    """An agent, and the transition that always comes: from 1, where Q = w + b, rewarded by 2."""

    def agent_of(settings, sources):
        one = torch.ones(len(sources), 1)
        step = Transition(one, one[:, 0].long() - 1, 2 * one[:, 0], one, one[:, 0].bool())
        return settings.agent(MLP((1, 1)), sources, 1, Rng("t", range(len(sources)))), step

    return agent_of
