"""Posteriors on another device: tried without one, on a processor that plays its part.

Tensors that would lie on the device are marked, and what PyTorch refuses is refused: operations
on tensors of both sides, and NumPy's view of a tensor on the device.
"""

from functools import partial

import pytest
import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode
from torch.utils._pytree import tree_leaves

from vtlab.bases import RBFLinear
from vtlib import posteriors
from vtlib.baselines import FineTuning, MellowTDSettings
from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.rng import Rng
from vtlib.transfer import Settings, VariationalTransfer
from vtlib.trust import Trust
from vtlib.units import FIRST

CARD = torch.device("cuda", 0)


class Marked(Tensor):
    """A tensor that would lie on the card."""


class PretendedCard(TorchFunctionMode):
    """PyTorch with a card that is none."""

    def __torch_function__(self, func, types, args=(), kwargs=None):
        kwargs = dict(kwargs or {})
        if func == Tensor.device.__get__ and isinstance(args[0], Marked):
            return CARD
        if func is Tensor.cpu:
            return args[0].as_subclass(Tensor)
        if func is Tensor.numpy and isinstance(args[0], Marked):
            raise TypeError("a tensor on the card has no numpy array")
        if func is Tensor.to and args[1] == CARD:
            return args[0].as_subclass(Marked)
        if kwargs.get("device") == CARD:
            return func(*args, **{**kwargs, "device": "cpu"}).as_subclass(Marked)
        # PyTorch takes numbers and indices of the processor on the card
        free = func in (Tensor.__getitem__, Tensor.__setitem__)
        tensors = [x for x in tree_leaves((args, kwargs)) if isinstance(x, Tensor)]
        sides = {isinstance(t, Marked) for t in tensors if t.dim() or free}
        if len(sides) == 2 and not (free and isinstance(args[0], Marked)):
            raise RuntimeError(f"{func} was given tensors of the card and of the processor")
        return func(*args, **kwargs)


SHORT = partial(Settings, lambda_=1e-2, alpha_L=1e-4, minibatch=3, n_samples=2)


@pytest.mark.parametrize("q", [RBFLinear(torch.arange(3.0), 0.5, 2), MLP((2, 9, 2))])
@pytest.mark.parametrize(
    "settings",
    [
        SHORT("gaussian", kl="diagonal", act="episode"),
        SHORT("gaussian", covariance="diagonal"),
        SHORT(components=3, kl="diagonal"),
        SHORT(components=3, init="mean", responsibilities="equal"),
        SHORT(components=3, covariance="diagonal", kl="diagonal"),
        Trust(),
        FineTuning(MellowTDSettings(epsilon_steps=9)),
    ],
)
def test_posteriors_stay_on_the_card_and_nothing_is_mixed(monkeypatch, q, settings):
    monkeypatch.setattr(posteriors, "kernels", lambda: None)  # they are the processor's
    g, obs, fresh = torch.Generator().manual_seed(0), torch.ones(2, 2), torch.tensor([True, False])
    with PretendedCard():
        sources = 0.3 * torch.randn(2, 4, q.d, generator=g)
        agent = settings.agent(q, sources.to(CARD), 2, Rng("device", [0, 1]))
        for t in range(FIRST + 2):
            action = agent.act(obs, fresh)
            reward = torch.tensor([1e5 if t % 7 == 6 else 1.0, 1.0])  # gradients are large then
            agent.learn(Transition(obs, action, reward, -obs, fresh))
        learned = getattr(agent, "learned", agent)
        parts = learned.mu, getattr(learned, "scale_tril", learned.mu), action
    there = isinstance(learned, VariationalTransfer)  # what has no posterior stays here
    assert [isinstance(x, Marked) for x in parts] == [there, there, False]
