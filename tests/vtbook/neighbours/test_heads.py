"""Heads: where they start, whom an episode follows, and prior functions that never learn."""

import pytest
import torch

from vtbook.neighbours import HeadsSettings
from vtlib.qfunctions import MLP, RBFLinear
from vtlib.replay import Transition
from vtlib.rng import Rng
from vtlib.td import mellowmax

Q = MLP((2, 3, 2))
RUNS = 2000
EACH = torch.ones(RUNS, dtype=torch.bool)


def normal(*shape):
    return torch.randn(shape, generator=torch.Generator().manual_seed(0))


def transition(runs, seed):
    obs = torch.rand(2, runs, 2, generator=torch.Generator().manual_seed(seed))
    return Transition(obs[0], EACH[:runs].long(), EACH[:runs].float(), obs[1], ~EACH[:runs])


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
def test_the_gradient_is_that_of_the_error_of_heads_with_their_prior_functions(psi):
    settings = HeadsSettings(heads=2, prior_scale=0.7, psi=psi, kappa=3.0)
    agent = settings.agent(Q, normal(1, 3, Q.d), 2, Rng("t", [0]))
    one, other = agent._disagree.unbind(1)
    w = agent.mu.clone().requires_grad_()
    batch = Transition(*(x.unsqueeze(1) for x in transition(1, 1)))

    def value(obs):
        x = Q.prepare(obs)
        return Q.q(w, x) + 0.7 * (Q.q(one, x) - Q.q(other, x))

    onward = mellowmax(value(batch.next_obs), 3.0, 2)
    # the next state's share psi of the gradient (eq. 5.4)
    target = batch.reward + 0.99 * (psi * onward + (1 - psi) * onward.detach())
    (target - value(batch.obs)[:, :, 1]).square().sum().backward()
    torch.testing.assert_close(agent._gradients(agent.mu, batch), w.grad)


def test_in_a_linear_q_function_a_prior_function_is_another_start():
    linear = RBFLinear(torch.arange(3.0), 0.5, 2)
    rng = Rng("t", range(4))
    ours = HeadsSettings(heads=3, prior_scale=0.5).agent(linear, normal(4, 3, linear.d), 2, rng)
    one, other = ours._disagree.unbind(1)
    away = 0.5 * (one - other)
    plain = HeadsSettings(heads=3).agent(linear, ours.mu + away, 2, rng)
    for seed in range(20):
        step = transition(4, seed)
        torch.testing.assert_close(*(x.act(step.obs, EACH[:4]) for x in (ours, plain)))
        ours.learn(step)
        plain.learn(step)
    torch.testing.assert_close(ours.mu + away, plain.mu, rtol=1e-4, atol=1e-5)
