"""Variational transfer: where it converges, when it learns and how it acts."""

from functools import partial
from types import SimpleNamespace

import pytest
import torch

from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.rng import Rng
from vtlib.transfer import Settings


def draw(*shape, seed=0):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def over(obs, reward):
    """The last transition of an episode, from action 0: the TD error is a regression's."""
    return Transition(obs, torch.zeros_like(reward).long(), reward, obs, reward == reward)


# The weight of the KL falls with the number of steps: the posterior follows with a lag of some
# steps in 2000, and Adam's steps do not shrink, hence five per cent.
# Several components that share one source are each on the same posterior.
@pytest.mark.parametrize(
    "changes",
    [
        {"family": "gaussian"},
        {"family": "gaussian", "covariance": "diagonal"},
        {},
        {"components": 3},
        {"components": 3, "responsibilities": "equal", "covariance": "dense"},
        {"components": 3, "covariance": "diagonal"},
    ],
)
def test_it_lands_on_the_conjugate_posterior(changes):
    d, steps, lambda_, size = 3, 2000, 1400.0, 8
    obs, reward = draw(size, d - 1, seed=1), draw(size, seed=2)
    # 2 d points with the mean and the covariance of a standard normal: quadratics are exact
    rotation = d**0.5 * torch.linalg.qr(draw(d, d, seed=5))[0]
    gaussian = changes.get("family") == "gaussian"
    sources = draw(1, 6 if gaussian else 1, d, seed=12)
    points = torch.cat([torch.zeros(1, d), rotation, -rotation])
    settings = Settings(
        lambda_=lambda_, minibatch=size, buffer=size, n_samples=2 * d, alpha_mu=3e-3,
        alpha_L=0.05 * changes.get("components", 1), sigma_p2=0.5, **changes,
    )  # fmt: skip
    chosen = {
        "posterior": points.repeat(settings.components, 1),
        "replay": (torch.arange(size) + 0.5) / size,
        "component": torch.zeros(1),
    }
    draws = {role: partial(numbers.reshape, 1) for role, numbers in chosen.items()}
    rng = Rng("fixed", [0])  # the same numbers at each draw
    rng.stream = lambda role: SimpleNamespace(normal=draws[role], uniform=draws[role])
    agent = settings.agent(MLP((d - 1, 1)), sources, d - 1, rng)
    for t in range(steps):
        agent.learn(over(obs[[t % size]], reward[[t % size]]))
    # a network without a hidden layer has a weight for each number, and one for a constant
    wide, x = sources[0].double(), torch.cat([obs, torch.ones(size, 1)], 1).double()
    prior = 0.5 * torch.eye(d, dtype=torch.float64)
    if gaussian:
        prior = torch.cov(wide.T, correction=0) + 1e-4 * torch.eye(d)
    precision, share = torch.linalg.inv(prior), 2 * steps / (lambda_ * size)
    sharp = precision + share * x.T @ x
    mean = torch.linalg.solve(sharp, precision @ wide.mean(0) + share * x.T @ reward.double())
    # the closest Gaussian without correlations has the same precisions
    closest = sharp.diagonal().diag() if changes.get("covariance") == "diagonal" else sharp
    whiten = torch.linalg.cholesky(closest).T
    for mu, L in zip(agent.mu[0].double(), agent.scale_tril[0].double(), strict=True):
        assert (whiten @ (mu - mean)).abs().max() < 0.05
        near = whiten @ L @ L.T @ whiten.T
        torch.testing.assert_close(near, torch.eye(d).double(), rtol=0, atol=0.05)


@pytest.mark.parametrize("changes", [{"family": "gaussian"}, {"components": 2}, {"init": "mean"}])
def test_the_first_iterations_may_only_act_and_remember_and_sources_are_left_alone(changes):
    patience, sources = 3, draw(2, 5, 6).requires_grad_()  # as those of a module
    settings = Settings(patience=patience, alpha_L=0.01, minibatch=4, n_samples=2, **changes)
    agent = settings.agent(MLP((1, 3)), sources, 1, Rng("patient", [0, 1]))
    mu, L = agent.mu.clone(), agent.scale_tril.clone()
    for t in range(patience + 1):
        assert torch.equal(agent.mu, mu)
        assert torch.equal(agent.scale_tril, L)
        samples = agent._samples
        agent.act(torch.zeros(2, 1), torch.ones(2, dtype=torch.bool))
        agent.learn(over(torch.ones(2, 1), torch.full((2,), float(t))))
        assert not torch.equal(agent._samples, samples)
    remembered = agent.remembered(torch.arange(0.1, 1, 0.2 / (patience + 1)).expand(2, -1))
    assert remembered.reward.unique().tolist() == list(range(patience + 1))
    assert not torch.equal(agent.mu, mu)
    assert not torch.equal(agent.scale_tril, L)
    assert torch.equal(sources, draw(2, 5, 6))
    assert sources.grad is None


@pytest.mark.parametrize("act", ["step", "episode"])
def test_weights_to_act_with_are_drawn_at_every_step_or_once_an_episode(act):
    # the last four runs' episodes are twice as long
    freshes = torch.arange(100).unsqueeze(1) % torch.tensor([5] * 4 + [10] * 4) == 0
    # a posterior that does not move
    settings = Settings(alpha_mu=1e-12, alpha_L=1e-12, lambda_=0.0, sigma_p2=1.0, act=act)
    agent = settings.agent(MLP((1, 4)), torch.zeros(8, 1, 8), 1, Rng("acting", range(8)))
    taken = []
    for fresh in freshes:
        taken.append(agent.act(torch.ones(8, 1), fresh))
        agent.learn(over(torch.zeros(8, 1), torch.zeros(8)))
    taken = torch.stack(taken)
    drawn = freshes if act == "episode" else torch.ones_like(freshes)
    changed, again = taken[1:] != taken[:-1], drawn[1:]
    assert not changed[~again].any()
    # four equally likely actions, five standard deviations
    assert (changed[again].float().mean() - 0.75).abs() < 5 * (0.19 / again.sum()) ** 0.5
    shares = torch.bincount(taken[drawn], minlength=4) / drawn.sum()
    assert (shares - 0.25).abs().max() < 5 * (0.19 / drawn.sum()) ** 0.5
