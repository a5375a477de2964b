"""Variational transfer: where it converges, when it learns and how it acts."""

from functools import partial
from types import SimpleNamespace

import pytest
import torch

from vtlib.priors import GaussianPrior
from vtlib.qfunctions import RBFLinear
from vtlib.replay import Transition
from vtlib.rng import Rng
from vtlib.transfer import Settings


def draw(*shape, seed=0):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


class Linear(RBFLinear):
    """Q of one weight per feature and action, with the observation itself as features."""

    def __init__(self, features, n_actions=1):
        self.n_actions = self.width = n_actions
        self.d = features * n_actions

    def prepare(self, obs):
        return obs.mT


def over(obs, reward):
    """The last transition of an episode, from action 0: the TD error is a regression's."""
    return Transition(obs, torch.zeros_like(reward).long(), reward, obs, reward == reward)


# --- where it converges --------------------------------------------------------------------------


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
    obs, reward = draw(size, d, seed=1), draw(size, seed=2)
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
    agent = settings.agent(Linear(d), sources, d, rng)
    for t in range(steps):
        agent.learn(over(obs[[t % size]], reward[[t % size]]))
    wide, x = sources[0].double(), obs.double()
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


# --- when it learns ------------------------------------------------------------------------------


@pytest.mark.parametrize("clip", [None, 5.0, 1000.0])
def test_gradients_of_the_means_are_clipped_and_followed_by_adam(clip):
    # hardly any variance, one transition: the gradient is that of the mean's own error
    settings = Settings(
        lambda_=0.0, clip=clip, minibatch=1, buffer=1, alpha_mu=0.1,
        sigma_p2=1e-14, sigma_min=1e-8, alpha_L=1e-12,
    )  # fmt: skip
    mu = draw(1, 1, 2)
    agent = settings.agent(Linear(2), mu, 2, Rng("clip", [0]))
    adam, bound = torch.optim.Adam([mu], lr=0.1), clip or torch.inf
    for t in range(20):
        obs, reward = draw(1, 2, seed=t), torch.tensor([1000.0 if t % 5 == 4 else 1.0])
        agent.learn(over(obs, reward))
        error = reward - (mu[0] * obs).sum(-1)
        mu.grad = (-2 * error * obs).clamp(-bound, bound).unsqueeze(0)
        adam.step()
        torch.testing.assert_close(agent.mu, mu, rtol=0, atol=1e-5)


@pytest.mark.parametrize(("patience", "kl"), [(0, "full"), (3, "full"), (0, "diagonal")])
def test_the_first_iterations_may_only_act_and_remember(patience, kl):
    settings = Settings(
        "gaussian", init="span", patience=patience, lambda_=0.6, alpha_L=0.01, jitter=0.5,
        sigma_min=0.2, minibatch=4, n_samples=2, kl=kl,
    )  # fmt: skip
    agent = settings.agent(Linear(2, 3), draw(2, 5, 6), 2, Rng("patient", [0, 1]))
    mu, L = agent.mu.clone(), agent.scale_tril.clone()
    for t in range(patience + 1):
        assert torch.equal(agent.mu, mu)
        assert torch.equal(agent.scale_tril, L)
        samples = agent._samples
        agent.act(torch.zeros(2, 2), torch.ones(2, dtype=torch.bool))
        # Q is zero there whatever the weights
        agent.learn(over(torch.zeros(2, 2), torch.full((2,), float(t))))
        assert not torch.equal(agent._samples, samples)
    remembered = agent.remembered(torch.arange(0.1, 1, 0.2 / (patience + 1)).expand(2, -1))
    assert remembered.reward.unique().tolist() == list(range(patience + 1))
    # the KL alone, and at the weight of the iteration
    precision, own = GaussianPrior(draw(2, 5, 6), 0.5).precision, L[:, 0].diagonal(dim1=1, dim2=2)
    gradient = (precision.times(L[:, 0]) - (1 / own).diag_embed()).tril()
    if kl == "diagonal":
        gradient = (precision.diagonal(6) * own - 1 / own).diag_embed()
    assert gradient.abs().max() > 1
    expected = L[:, 0] - 0.01 * 0.6 / (patience + 1) * gradient
    expected.diagonal(dim1=1, dim2=2).clamp_(min=0.2)
    torch.testing.assert_close(agent.scale_tril[:, 0], expected)


# --- how it acts ---------------------------------------------------------------------------------


def actions(q, sources, freshes, **changes):
    """Actions (steps, R) at one and the same observation of a posterior that does not move."""
    settings = Settings(alpha_mu=1e-12, alpha_L=1e-12, lambda_=0.0, n_samples=1, **changes)
    runs, features = len(sources), q.d // q.n_actions
    agent = settings.agent(q, sources, features, Rng("acting", range(runs)))
    taken = []
    for fresh in freshes:
        taken.append(agent.act(torch.ones(runs, features), fresh))
        agent.learn(over(torch.zeros(runs, features), torch.zeros(runs)))
    return torch.stack(taken)


@pytest.mark.parametrize("act", ["step", "episode"])
def test_weights_to_act_with_are_drawn_at_every_step_or_once_an_episode(act):
    # the last four runs' episodes are twice as long
    freshes = torch.arange(100).unsqueeze(1) % torch.tensor([5] * 4 + [10] * 4) == 0
    taken = actions(Linear(2, 4), torch.zeros(8, 1, 8), freshes, sigma_p2=1.0, act=act)
    drawn = freshes if act == "episode" else torch.ones_like(freshes)
    changed, again = taken[1:] != taken[:-1], drawn[1:]
    assert not changed[~again].any()
    # four equally likely actions, five standard deviations
    assert (changed[again].float().mean() - 0.75).abs() < 5 * (0.19 / again.sum()) ** 0.5
    shares = torch.bincount(taken[drawn], minlength=4) / drawn.sum()
    assert (shares - 0.25).abs().max() < 5 * (0.19 / drawn.sum()) ** 0.5


@pytest.mark.parametrize("changes", [{"family": "gaussian"}, {"components": 2}, {"init": "mean"}])
def test_sources_are_left_alone_and_may_belong_to_a_module(changes):
    sources = draw(2, 4, 6).requires_grad_()
    agent = Settings(alpha_mu=0.1, **changes).agent(Linear(2, 3), sources, 2, Rng("t", [0, 1]))
    agent.learn(over(torch.ones(2, 2), torch.ones(2)))
    assert not torch.equal(agent.mu[:, 0], draw(2, 4, 6)[:, 0])
    assert torch.equal(sources, draw(2, 4, 6))
    assert sources.grad is None
