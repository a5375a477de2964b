"""The pulled vector: one step by its formula, where it is pulled, and what is held."""

import pytest
import torch

from vtbook.neighbours import AnchoredSettings
from vtlab.envs.rooms import RoomsFamily
from vtlib.replay import Transition
from vtlib.rng import Rng

STRENGTH, STEPS = 3.0, 6


@pytest.mark.parametrize("pull", ["everywhere", "seen", "unseen"])
@pytest.mark.parametrize("held", [False, True])
def test_a_step_is_its_formula(pull, held, on_a_line):
    sources = torch.randn(2, 3, 2, generator=torch.Generator().manual_seed(0))
    # both slopes of w + b at 1 are 1, so that the third step is the first to see enough
    how = AnchoredSettings(
        strength=STRENGTH, pull=pull, enough=2.5, held=held, alpha=0.02, epsilon=0.5, minibatch=2
    )
    agent, step = on_a_line(how, sources)
    mean = sources.mean(1, keepdim=True)
    w = mean.clone().requires_grad_()
    adam = torch.optim.Adam([w], lr=0.02, eps=0.5)
    for t in range(1, STEPS):
        agent.learn(step)
        seen = t >= 3
        pulled = pull == "everywhere" or (pull == "seen") == seen
        away = STRENGTH / t * (w.detach() - mean)
        before = w.detach().clone()
        w.grad = 2 * (w.detach().sum(-1, keepdim=True) - 2.0) + pulled * away
        adam.step()
        if held and not seen:
            w.data.copy_(before)
        torch.testing.assert_close(agent.mu, w.detach(), rtol=1e-4, atol=1e-5)


def test_only_weights_of_the_place_and_the_action_taken_are_seen():
    """In rooms an unseen weight that is held keeps its value, and a seen one moves."""
    q = RoomsFamily().q()
    sources = torch.randn(1, 2, q.d, generator=torch.Generator().manual_seed(1))
    settings = AnchoredSettings(strength=0.0, enough=0.5, held=True, minibatch=4)
    agent = settings.agent(q, sources, 2, Rng("t", range(1)))
    start = agent.mu.clone()
    here, there = torch.tensor([[3.0, 3.0]]), torch.tensor([[7.0, 7.0]])
    action, ended = torch.tensor([2]), torch.tensor([False])
    agent.learn(Transition(here, action, torch.tensor([1.0]), there, ended))
    expected = [2 * 121 + 3 * 11 + 3]  # of that action, at that centre
    assert agent.seen.nonzero()[:, -1].tolist() == expected
    assert (agent.mu != start).nonzero()[:, -1].tolist() == expected
