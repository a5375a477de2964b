"""Heads: where they start, whom an episode follows, and prior functions that never learn."""

import pytest
import torch

from vtbook.neighbours import HeadsSettings
from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.rng import Rng
from vtlib.td import mellowmax

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


@pytest.mark.parametrize("psi", [0.0, 0.5, 1.0])
def test_actions_and_gradients_are_those_of_heads_with_their_prior_functions(psi):
    settings = HeadsSettings(heads=2, prior_scale=0.7, psi=psi, kappa=3.0)
    agent = settings.agent(Q, normal(50, 3, Q.d), 2, Rng("t", range(50)))
    one, other = agent._disagree.unbind(1)
    w, obs = agent.mu.clone().requires_grad_(), normal(2, 50, 1, 2)
    each = EACH[:50].unsqueeze(1)
    batch = Transition(obs[0], each.long(), each.float(), obs[1], ~each)

    def value(obs):
        x = Q.prepare(obs)
        return Q.q(w, x) + 0.7 * (Q.q(one, x) - Q.q(other, x))

    onward = mellowmax(value(batch.next_obs), 3.0, 2)
    # the next state's share psi of the gradient (eq. 5.4)
    target = batch.reward.unsqueeze(1) + 0.99 * (psi * onward + (1 - psi) * onward.detach())
    (target - value(batch.obs)[:, :, 1]).square().sum().backward()
    torch.testing.assert_close(agent._gradients(agent.mu, batch), w.grad)
    taken = agent.act(obs[0, :, 0], EACH[:50])
    followed = value(batch.obs)[torch.arange(50), agent._head, :, 0]
    torch.testing.assert_close(taken, followed.argmax(1))
    # prior functions never learn
    before = agent._disagree.clone()
    agent.learn(Transition(*(x.squeeze(1) for x in batch)))
    assert not torch.equal(agent.mu, w)
    torch.testing.assert_close(agent._disagree, before, rtol=0, atol=0)
