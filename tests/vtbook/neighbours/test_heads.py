"""Heads: where they start, whom an episode follows, and prior functions that never learn."""

from __future__ import annotations

import pytest
import torch

from vtbook.neighbours import HeadsSettings
from vtlib.qfunctions import MLP, RBFLinear
from vtlib.replay import Transition
from vtlib.rng import Rng
from vtlib.td import mellowmax

Q = MLP((2, 3, 2))


def normal(*shape, seed=0):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def transition(runs, seed=1):
    obs = torch.rand(2, runs, 2, generator=torch.Generator().manual_seed(seed))
    no = torch.zeros(runs, dtype=torch.bool)
    return Transition(obs[0], torch.ones(runs).long(), torch.ones(runs), obs[1], no)


def test_heads_start_at_the_sources_in_turn_and_one_is_followed_for_an_episode():
    runs, heads = 2000, 3
    sources = normal(1, 2, Q.d).expand(runs, -1, -1)
    agent = HeadsSettings(heads=heads).agent(Q, sources, 2, Rng("t", range(runs)))
    torch.testing.assert_close(agent.mu, sources[:, [0, 1, 0]])
    new, same = torch.ones(runs, dtype=torch.bool), torch.zeros(runs, dtype=torch.bool)
    followed = agent._acting(new)
    torch.testing.assert_close(agent._acting(same), followed)
    counts = torch.bincount(agent._head, minlength=heads)
    assert (counts - runs / heads).abs().max() < 5 * (runs * 2 / 9) ** 0.5
    assert (agent._acting(new) != followed).any()


@pytest.mark.parametrize("psi", [0.0, 0.5, 1.0])
def test_the_gradient_is_that_of_the_error_of_heads_with_their_prior_functions(psi):
    settings = HeadsSettings(heads=2, prior_scale=0.7, psi=psi, kappa=3.0)
    agent = settings.agent(Q, normal(1, 3, Q.d), 2, Rng("t", [0]))
    one, other = agent._disagree.unbind(1)
    w = agent.mu.clone().requires_grad_()
    batch = Transition(*(x.unsqueeze(1) for x in transition(1)))

    def value(obs, weights):
        x = Q.prepare(obs)
        return Q.q(weights, x) + 0.7 * (Q.q(one, x) - Q.q(other, x))

    here, there = value(batch.obs, w)[:, :, 1], value(batch.next_obs, w)
    # the next state's share psi of the gradient (eq. 5.4)
    target = psi * mellowmax(there, 3.0, 2) + (1 - psi) * mellowmax(there, 3.0, 2).detach()
    (batch.reward + 0.99 * target - here).square().sum().backward()
    torch.testing.assert_close(agent._gradients(agent.mu, batch), w.grad)


def test_in_a_linear_q_function_a_prior_function_is_another_start():
    linear = RBFLinear(torch.arange(3.0), 0.5, 2)
    sources, rng = normal(4, 3, linear.d), Rng("t", range(4))
    with_prior = HeadsSettings(heads=3, prior_scale=0.5).agent(linear, sources, 2, rng)
    one, other = with_prior._disagree.unbind(1)
    moved = with_prior.mu + 0.5 * (one - other)
    without = HeadsSettings(heads=3).agent(linear, moved, 2, rng)
    for seed in range(20):
        step = transition(4, seed)
        a, b = (x.act(step.obs, torch.ones(4, dtype=torch.bool)) for x in (with_prior, without))
        torch.testing.assert_close(a, b)
        with_prior.learn(step)
        without.learn(step)
    torch.testing.assert_close(
        with_prior.mu + 0.5 * (one - other), without.mu, rtol=1e-4, atol=1e-5
    )
