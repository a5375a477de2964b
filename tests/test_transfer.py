"""Algorithm 1: its gradients, where it starts, how it acts and where it converges."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import pytest
import torch
from torch import Tensor

from vtlib import transfer
from vtlib.envs.episodes import Episodes
from vtlib.factor import CholeskyFactors
from vtlib.gaussian import Gaussian, Precision, kl_gradients, low_rank_precision
from vtlib.mellow import td_error
from vtlib.mixture import kl_bound, pairwise_kl, responsibilities
from vtlib.qfunctions import MLP, RBFLinear
from vtlib.replay import Transition
from vtlib.streams import Stream
from vtlib.transfer import (
    Settings,
    VariationalTransfer,
    check_sources,
    initial_posterior,
    td_gradients,
)


def draw(*shape: int, seed: int = 0, dtype: torch.dtype = torch.float32) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=dtype)


class Linear:
    """Q of one weight per feature and action, with the observation itself as features."""

    def __init__(self, features: int, n_actions: int = 1) -> None:
        self.n_actions = self.width = n_actions
        self.d = features * n_actions

    def prepare(self, obs: Tensor) -> Tensor:
        return obs

    def q(self, w: Tensor, x: Tensor) -> Tensor:
        rows = w.unflatten(-1, (self.n_actions, -1))
        return torch.einsum("rkaf,rbf->rkab", rows, x)

    def vjp(self, w: Tensor, x: Tensor) -> tuple[Tensor, Callable[[Tensor], Tensor]]:
        return self.q(w, x), lambda c: torch.einsum("rkab,rbf->rkaf", c, x).flatten(-2)


class Fixed:
    """Stands in for a stream: the same numbers (R, n) at every draw."""

    def __init__(self, numbers: Tensor) -> None:
        self._numbers = numbers

    def __len__(self) -> int:
        return len(self._numbers)

    def normal(self, n: int) -> Tensor:
        assert self._numbers.shape[1] == n
        return self._numbers

    uniform = normal


def streams(runs: list[int]) -> tuple[Stream, Stream, Stream]:
    return tuple(Stream("test", runs, role) for role in ("noise", "component", "replay"))


def transitions(runs: int, batch: int, q: Linear, dtype=torch.float32, over=None) -> Transition:
    """Random transitions; over: probability of a terminal next state."""
    features = q.d // q.n_actions
    g = torch.Generator().manual_seed(11)
    return Transition(
        draw(runs, batch, features, seed=1, dtype=dtype),
        torch.randint(q.n_actions, (runs, batch), generator=g),
        draw(runs, batch, seed=2, dtype=dtype),
        draw(runs, batch, features, seed=3, dtype=dtype),
        torch.rand(runs, batch, generator=g) < (0.3 if over is None else over),
    )


def exact_moments(d: int) -> Tensor:
    """2 d points with the mean and the covariance of a standard normal: quadratics are exact."""
    rotation, _ = torch.linalg.qr(draw(d, d, seed=5, dtype=torch.float64))
    points = d**0.5 * torch.cat([rotation, -rotation])
    return points.float()


# --- the gradient of the squared TD error -------------------------------------------------------


def mean_squared_td_error(q, w: Tensor, batch: Transition, **constants: float) -> Tensor:
    """The loss (R, K) whose gradient eq. 5.4 describes."""
    error = td_error(
        q.q(w, q.prepare(batch.obs)),
        q.q(w, q.prepare(batch.next_obs)),
        *(part.unsqueeze(1) for part in (batch.action, batch.reward, batch.terminal)),
        **constants,
    )
    return error.square().mean(-1)


@pytest.mark.parametrize(
    "q", [Linear(2, 3), RBFLinear(torch.arange(-2.0, 3.0), 1.0, 3), MLP((2, 6, 3))],
    ids=["linear", "rbf", "mlp"],
)  # fmt: skip
def test_psi_one_is_autograds_gradient_and_zero_the_semi_gradient(q):
    batch = transitions(2, 20, Linear(2, 3))
    w = 0.3 * draw(2, 4, q.d, seed=4)
    constants = {"gamma": 0.9, "kappa": 20.0}
    leaf = w.clone().requires_grad_()
    loss = mean_squared_td_error(q, leaf, batch, **constants)
    (full,) = torch.autograd.grad(loss.sum(), leaf)
    # the semi-gradient: the same loss with the targets computed from weights held constant
    targets = td_error(
        torch.zeros(2, 4, 3, 20), q.q(w, q.prepare(batch.next_obs)),
        *(part.unsqueeze(1) for part in batch[1:3]), batch.terminal.unsqueeze(1), **constants,
    )  # fmt: skip
    index = batch.action.view(2, 1, 1, 20).expand(2, 4, 1, 20)
    chosen = q.q(leaf, q.prepare(batch.obs)).gather(2, index).squeeze(2)
    (semi,) = torch.autograd.grad((targets - chosen).square().mean(-1).sum(), leaf)
    for psi in (0.0, 0.3, 1.0):
        ours = td_gradients(q, w, batch, psi, **constants)
        torch.testing.assert_close(ours, psi * full + (1 - psi) * semi, rtol=1e-3, atol=1e-5)
    assert (full - semi).abs().max() > 0.01


def test_gradient_of_terminal_transitions_ignores_the_next_state():
    q = Linear(2, 3)
    batch = transitions(1, 20, q, over=1.0)
    w = draw(1, 4, q.d, seed=4)
    elsewhere = batch._replace(next_obs=batch.next_obs + 5)
    first = td_gradients(q, w, batch, 1.0, 0.9, 20.0)
    torch.testing.assert_close(first, td_gradients(q, w, elsewhere, 0.0, 0.9, 20.0))


def test_reparameterised_gradients_are_unbiased():
    """Eqs. 5.10 and 5.11 by Monte Carlo, against finite differences of the closed form."""
    samples, d = 200_000, 4
    q = Linear(d)
    batch = transitions(1, 7, q, torch.float64, over=1.0)
    mu = draw(d, seed=6, dtype=torch.float64)
    L = draw(d, d, seed=7, dtype=torch.float64).tril()
    x, target = batch.obs[0], batch.reward[0]

    def expected(mu: Tensor, L: Tensor) -> float:
        return ((target - x @ mu).square() + (x @ L).square().sum(1)).mean().item()

    z = draw(samples, d, seed=8, dtype=torch.float64)
    gradient = td_gradients(q, (mu + z @ L.T).unsqueeze(0), batch, 0.5, 0.99, 100.0)[0]
    outer = gradient.unsqueeze(2) * z.unsqueeze(1)
    h = 1e-4  # the closed form is quadratic: central differences are exact to rounding
    for i in range(d):
        step = torch.zeros(d, dtype=torch.float64)
        step[i] = h
        slope = (expected(mu + step, L) - expected(mu - step, L)) / (2 * h)
        error = gradient[:, i].std().item() / samples**0.5
        assert gradient[:, i].mean().item() == pytest.approx(slope, abs=5 * error)
        for j in range(i + 1):
            step = torch.zeros(d, d, dtype=torch.float64)
            step[i, j] = h
            slope = (expected(mu, L + step) - expected(mu, L - step)) / (2 * h)
            error = outer[:, i, j].std().item() / samples**0.5
            assert outer[:, i, j].mean().item() == pytest.approx(slope, abs=5 * error)


def test_reparameterised_gradients_at_fixed_noise_are_autograds():
    """With bootstrapped targets too: psi = 1, and the noise held while mu and L move."""
    q = Linear(2, 3)
    batch = transitions(1, 9, q, torch.float64)
    z = draw(50, q.d, seed=8, dtype=torch.float64)
    mu = draw(q.d, seed=6, dtype=torch.float64).requires_grad_()
    L = draw(q.d, q.d, seed=7, dtype=torch.float64).tril().requires_grad_()
    w = (mu + z @ L.T).unsqueeze(0)
    loss = mean_squared_td_error(q, w, batch, gamma=0.9, kappa=20.0).mean()
    by_mu, by_factor = torch.autograd.grad(loss, [mu, L])
    gradients = td_gradients(q, w.detach(), batch, 1.0, 0.9, 20.0)[0] / len(z)
    torch.testing.assert_close(gradients.sum(0), by_mu)
    torch.testing.assert_close(gradients.T @ z, by_factor)


# --- the posterior in the conjugate case --------------------------------------------------------


@dataclass
class Conjugate:
    """Linear regression: fixed targets, so that eq. 5.1 with a Gaussian prior is Gaussian."""

    q: Linear
    data: Transition  # (1, B)

    def posterior(self, mu_p: Tensor, precision: Tensor, temperature: float) -> Gaussian:
        """Mean and covariance of exp(-mean squared error / temperature) times the prior."""
        x, target = self.data.obs[0].double(), self.data.reward[0].double()
        share = 2 / (temperature * len(target))
        covariance = torch.linalg.inv(precision + share * x.T @ x)
        return Gaussian(covariance @ (precision @ mu_p + share * x.T @ target), covariance)


def regression(d: int = 3, batch: int = 8) -> Conjugate:
    q = Linear(d)
    return Conjugate(q, transitions(1, batch, q, over=1.0))


def assert_near(mu: Tensor, L: Tensor, exact: Gaussian, tolerance: float) -> None:
    """Mean and covariance to a tolerance, in units of the posterior's standard deviations."""
    whiten = torch.linalg.inv(torch.linalg.cholesky(exact.L))
    shift = whiten @ (mu.double() - exact.mu)
    assert shift.abs().max() < tolerance
    covariance = whiten @ (L.double() @ L.double().T) @ whiten.T
    torch.testing.assert_close(
        covariance, torch.eye(len(mu), dtype=torch.float64), rtol=0, atol=tolerance
    )


@pytest.mark.parametrize("kind", ["isotropic", "low rank"])
def test_gradient_steps_land_on_the_conjugate_posterior(kind):
    case, d, temperature = regression(), 3, 0.7
    mu_p = draw(1, d, seed=12)
    if kind == "isotropic":
        precision = Precision(2.0)
    else:
        precision = low_rank_precision(0.7 * draw(1, d, 2, seed=13), 0.2)
    noise = exact_moments(d).unsqueeze(0)
    mu = torch.zeros(1, d)
    factors = CholeskyFactors(torch.eye(d).unsqueeze(0), precision, 0.05, 1e-4, 1000.0)
    adam = torch.optim.Adam([mu], lr=0.01)
    decay = torch.optim.lr_scheduler.ExponentialLR(adam, 0.995)
    for _ in range(1500):
        factors.look_ahead(noise.unsqueeze(0))
        w = mu.unsqueeze(1) + factors.product(0)
        gradients = td_gradients(case.q, w, case.data, 0.5, 0.99, 100.0) / noise.shape[1]
        q = Gaussian(mu, factors.L)
        mu.grad = gradients.sum(1) + temperature * kl_gradients(q, mu_p, precision)[0]
        adam.step()
        decay.step()
        factors.step(gradients, noise, temperature)
    matrix = precision.times(torch.eye(d).unsqueeze(0))[0].double()
    exact = case.posterior(mu_p[0].double(), matrix, temperature)
    assert_near(mu[0], factors.L[0], exact, tolerance=1e-3)


# The weight of the KL falls with the number of steps: the posterior follows with a lag of some
# steps in 2000, and Adam's steps do not shrink, hence five per cent.
# Several components that share one source are each on the same posterior.
@pytest.mark.parametrize(
    ("family", "components"), [("gaussian", 1), ("mixture", 1), ("mixture", 3)]
)
def test_variational_transfer_lands_on_the_conjugate_posterior(family, components):
    case, d, steps, lambda_ = regression(), 3, 2000, 1400.0
    sources = draw(1, 6 if family == "gaussian" else 1, d, seed=12)
    points = exact_moments(d)
    drawn = torch.cat([torch.zeros(1, d), points]).view(1, -1).repeat(1, components)
    settings = Settings(
        family=family, components=components, lambda_=lambda_,
        batch=8, buffer=8, weights=len(points),
        alpha_mu=3e-3, alpha_L=0.05 * components, sigma_p2=0.5,
    )  # fmt: skip
    everything = (torch.arange(8) + 0.5).unsqueeze(0) / 8
    agent = VariationalTransfer(
        case.q, sources, d, settings, Fixed(drawn), Stream("test", [0], "component"),
        Fixed(everything),
    )  # fmt: skip
    for t in range(steps):
        agent.learn(Transition(*(part[:, t % 8] for part in case.data)))
    wide = sources[0].double()
    if family == "gaussian":
        covariance = torch.cov(wide.T, correction=0) + 1e-4 * torch.eye(d)
    else:
        covariance = 0.5 * torch.eye(d, dtype=torch.float64)
    exact = case.posterior(wide.mean(0), torch.linalg.inv(covariance), lambda_ / steps)
    for c in range(components):
        assert_near(agent.mu[0, c], agent.L[0, c], exact, tolerance=0.05)


def test_without_a_kl_the_mean_fits_the_targets():
    case = regression(d=3, batch=12)
    agent = VariationalTransfer(
        case.q, draw(1, 2, 3, seed=12), 3,
        Settings(lambda_=0.0, batch=64, alpha_mu=5e-3), *streams([0]),
    )  # fmt: skip
    for t in range(2000):
        agent.learn(Transition(*(part[:, t % 12] for part in case.data)))
    fit = torch.linalg.lstsq(case.data.obs[0], case.data.reward[0]).solution
    torch.testing.assert_close(agent.mu[0, 0], fit, rtol=0, atol=0.1)


# --- where it starts ----------------------------------------------------------------------------


def test_a_gaussian_starts_at_the_sources_mean_and_covariance():
    sources = draw(2, 5, 4)
    posterior, precision = initial_posterior(sources, Settings(family="gaussian", init="span"))
    for r in range(2):
        torch.testing.assert_close(posterior.mu[r, 0], sources[r].mean(0))
        covariance = torch.cov(sources[r].T, correction=0)
        L = posterior.L[r, 0]
        torch.testing.assert_close(L @ L.T, covariance, rtol=0, atol=1e-5)
        # the prior's precision is that of the covariance with its own jitter
        eye = torch.eye(4)
        dense = precision.times(eye)[r] @ (covariance + 1e-4 * eye)
        torch.testing.assert_close(dense, eye, rtol=0, atol=1e-2)


def bound(posterior: Gaussian, sources: Tensor, variance: float) -> Tensor:
    pairwise = pairwise_kl(posterior, sources, variance)
    return kl_bound(pairwise, *responsibilities(pairwise))


def mixture_start(components: int, count: int, init: str) -> tuple[Gaussian, Tensor, Settings]:
    """A start in float64, for comparisons of bounds."""
    sources = draw(1, count, 20, dtype=torch.float64)
    settings = Settings(components=components, init=init)
    posterior, _ = initial_posterior(sources, settings)
    return Gaussian(posterior.mu, posterior.L.double()), sources, settings


@pytest.mark.parametrize(("components", "count"), [(1, 6), (3, 6), (4, 4), (5, 3)])
def test_starting_on_sources_minimises_the_bound(components, count):
    start, sources, settings = mixture_start(components, count, "sources")
    variance = settings.sigma_p2
    least = bound(start, sources, variance)
    mean, _, _ = mixture_start(components, count, "mean")
    assert least < bound(mean, sources, variance)
    slack = 1e-6
    for seed in range(20):
        for size in (1e-4, 1e-3, 1e-2, 1.0):
            move = size * draw(*start.mu.shape, seed=seed, dtype=torch.float64)
            assert bound(Gaussian(start.mu + move, start.L), sources, variance) >= least - slack
            grow = 1 + size * torch.rand(1, generator=torch.Generator().manual_seed(seed)).item()
            for factor in (grow, 1 / grow):
                other = Gaussian(start.mu, factor * start.L)
                assert bound(other, sources, variance) >= least - slack
            tilt = 1e-3 * size * draw(*start.L.shape, seed=seed, dtype=torch.float64).tril(-1)
            assert bound(Gaussian(start.mu, start.L + tilt), sources, variance) >= least - slack


def test_components_start_on_different_sources():
    start, sources, _ = mixture_start(3, 6, "sources")
    distances = torch.cdist(start.mu[0], sources[0])
    assert (distances.min(1).values == 0).all()
    assert distances.argmin(1).unique().numel() == 3


def test_starting_at_the_mean_puts_all_components_on_one_spot():
    start, sources, settings = mixture_start(3, 6, "mean")
    torch.testing.assert_close(start.mu[0], sources[0].mean(0).expand(3, -1))
    deviation = settings.sigma_p2**0.5 * torch.eye(20)
    torch.testing.assert_close(start.L[0].float(), deviation.expand(3, 20, 20))


def test_a_gaussian_starts_at_the_minimiser_which_is_the_prior():
    sources = draw(2, 5, 4)
    posterior, precision = initial_posterior(sources, Settings(family="gaussian"))
    for r in range(2):
        L = posterior.L[r, 0]
        dense = precision.times(posterior.L[:, 0])[r]
        torch.testing.assert_close(dense @ L.T, torch.eye(4), rtol=0, atol=1e-3)


@pytest.mark.parametrize(("family", "init"), [("gaussian", "mean"), ("mixture", "span")])
def test_each_family_has_its_own_other_start(family, init):
    with pytest.raises(ValueError, match="init must be one of"):
        Settings(family=family, init=init)


def test_without_correlations_a_gaussian_starts_at_the_minimiser_among_its_like():
    sources = draw(2, 5, 4)
    settings = Settings(family="gaussian", covariance="diagonal")
    posterior, precision = initial_posterior(sources, settings)
    assert torch.equal(posterior.L, torch.diag_embed(posterior.L.diagonal(dim1=-2, dim2=-1)))
    # there the gradient of the KL with respect to each deviation vanishes
    dense = precision.times(torch.eye(4).expand(2, 4, 4))
    pull = dense.diagonal(dim1=1, dim2=2) * posterior.L[:, 0].diagonal(dim1=1, dim2=2).square()
    torch.testing.assert_close(pull, torch.ones(2, 4), rtol=0, atol=1e-3)
    torch.testing.assert_close(posterior.mu[:, 0], sources.mean(1))


@pytest.mark.parametrize("family", ["gaussian", "mixture"])
def test_a_diagonal_posterior_stays_diagonal_while_it_learns(family):
    q = Linear(2, 3)
    settings = Settings(family=family, covariance="diagonal", batch=5)
    agent = VariationalTransfer(q, draw(2, 4, 6), 2, settings, *streams([0, 1]))
    before = agent.L.clone()
    agent.learn(Transition(*(part[:, 0] for part in transitions(2, 1, q))))
    assert torch.equal(agent.L, torch.diag_embed(agent.L.diagonal(dim1=-2, dim2=-1)))
    assert not torch.equal(agent.L, before)


def test_a_diagonal_posterior_has_no_span_to_start_in():
    with pytest.raises(ValueError, match="cannot start within the span"):
        Settings(family="gaussian", init="span", covariance="diagonal")
    with pytest.raises(ValueError, match="covariance must be one of"):
        Settings(covariance="banded")


def test_large_posteriors_learn_as_small_ones_do(monkeypatch):
    q, runs = Linear(2, 3), [0, 1]

    def learned(large: int) -> VariationalTransfer:
        monkeypatch.setattr(transfer, "LARGE", large)
        # with one weight a draw for all iterations ahead holds the numbers of single draws
        agent = VariationalTransfer(q, draw(2, 4, 6), 2, Settings(batch=5), *streams(runs))
        for t in range(20):
            agent.act(torch.zeros(2, 2), torch.ones(2, dtype=torch.bool))
            agent.learn(Transition(*(part[:, t] for part in transitions(2, 20, q))))
        return agent

    small, large = learned(7), learned(6)
    assert type(small._factors) is not type(large._factors)
    torch.testing.assert_close(large.mu, small.mu, rtol=0, atol=1e-5)
    torch.testing.assert_close(large.L, small.L, rtol=0, atol=1e-5)


@pytest.mark.parametrize("family", ["gaussian", "mixture"])
def test_sources_are_left_alone(family):
    q, sources = Linear(2, 3), draw(2, 4, 6)
    before = sources.clone()
    settings = Settings(family=family, alpha_mu=0.1)
    agent = VariationalTransfer(q, sources, 2, settings, *streams([0, 1]))
    agent.learn(Transition(*(part[:, 0] for part in transitions(2, 1, q))))
    assert torch.equal(sources, before)


# --- acting -------------------------------------------------------------------------------------


def still_agent(q: Linear, sources: Tensor, runs: list[int], **changes) -> VariationalTransfer:
    """An agent whose posterior does not move, for tests of acting alone."""
    settings = Settings(alpha_mu=1e-12, alpha_L=1e-12, lambda_=0.0, weights=1, **changes)
    return VariationalTransfer(q, sources, q.d // q.n_actions, settings, *streams(runs))


def actions(agent: VariationalTransfer, q: Linear, freshes: list[list[bool]]) -> Tensor:
    """Actions (steps, R) at one and the same observation."""
    runs = len(freshes[0])
    nothing = Transition(*(part[:, 0] for part in transitions(runs, 1, q)))
    taken = []
    for fresh in freshes:
        taken.append(agent.act(torch.ones(runs, q.d // q.n_actions), torch.tensor(fresh)))
        agent.learn(nothing)
    return torch.stack(taken)


def test_acting_by_step_draws_weights_anew_at_every_step():
    q = Linear(2, 4)
    agent = still_agent(q, torch.zeros(3, 1, q.d), [0, 1, 2], sigma_p2=1.0)
    taken = actions(agent, q, [[False] * 3] * 200)
    for r in range(3):
        # four equally likely actions: 50 each, with a standard deviation of 6.1
        counts = torch.bincount(taken[:, r], minlength=4)
        assert (counts > 25).all()
        assert (counts < 75).all()


def test_acting_by_episode_keeps_its_weights_until_the_next_first_step():
    q = Linear(2, 4)
    agent = still_agent(q, torch.zeros(2, 1, q.d), [0, 1], sigma_p2=1.0, act="episode")
    length, count = 5, 80
    # the second run's episodes are twice as long
    freshes = [[t % length == 0, t % (2 * length) == 0] for t in range(length * count)]
    taken = actions(agent, q, freshes)
    first, second = taken[:, 0].view(-1, length), taken[:, 1].view(-1, 2 * length)
    assert (first == first[:, :1]).all()
    assert (second == second[:, :1]).all()
    assert torch.bincount(first[:, 0], minlength=4).min() > 5
    assert torch.bincount(second[:, 0], minlength=4).min() > 2


@pytest.mark.parametrize("act", ["step", "episode"])
def test_components_act_equally_often(act):
    q = Linear(1, 3)
    sources = torch.eye(3).unsqueeze(0)
    agent = still_agent(q, sources, [0], components=3, act=act)
    counts = torch.bincount(actions(agent, q, [[True]] * 900)[:, 0], minlength=3)
    # binomial with mean 300: five standard deviations are 71
    assert (counts - 300).abs().max() < 71


# --- many runs at once --------------------------------------------------------------------------


class Walks:
    """Random walks in the plane whose episodes end at different times; run r has its own goal."""

    n_actions, obs_dim, noise_dim, start_dim, horizon, gamma = 4, 2, 2, 2, 12, 0.99

    def __init__(self, goals: Tensor) -> None:
        self._goals = goals

    def __len__(self) -> int:
        return len(self._goals)

    def start(self, u: Tensor) -> Tensor:
        return u - 0.5

    def step(self, state: Tensor, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        moves = torch.tensor([[0.0, 0.5], [0.5, 0.0], [0.0, -0.5], [-0.5, 0.0]])
        state = state + moves[action] + 0.3 * noise
        terminal = (state - self._goals).square().sum(1) < 1
        return state, terminal.float(), terminal

    def observe(self, state: Tensor) -> Tensor:
        return state


GOALS = torch.tensor([[1.0, 0.0], [0.0, 1.5], [-1.0, -1.0], [1.0, 1.0], [0.0, -1.0]])
BASES = RBFLinear(torch.arange(-3.0, 3.5, 1.5), 0.5, 4)


def course(runs: list[int], settings: Settings, iterations: int = 100) -> tuple[Tensor, ...]:
    """Means, factors and all observations of some of five runs."""
    sources = draw(5, 4, BASES.d, seed=3)[runs]
    agent = VariationalTransfer(BASES, sources, 2, settings, *streams(runs))
    episodes = Episodes(
        Walks(GOALS[runs]), Stream("test", runs, "steps"), Stream("test", runs, "starts")
    )
    seen = []
    for _ in range(iterations):
        agent.learn(episodes.step(agent.act(episodes.obs, episodes.fresh)))
        seen.append(episodes.obs)
    return agent.mu, agent.L, torch.stack(seen, 1)


@pytest.mark.parametrize(
    "settings",
    [
        Settings(family="gaussian", lambda_=1e-2),
        Settings(),
        Settings(components=3),
        Settings(components=3, init="mean", lambda_=1e-2),
        Settings(components=3, act="episode"),
        Settings(components=2, sigma_p2=5.0, lambda_=1.0, alpha_L=0.01),
    ],
    ids=["gaussian", "one", "three", "mean", "episode", "wide"],
)
def test_a_run_does_not_feel_its_neighbours(settings):
    together, alone = course([0, 1, 2, 3, 4], settings), course([3], settings)
    for all_runs, one in zip(together, alone, strict=True):
        torch.testing.assert_close(all_runs[3], one[0], rtol=1e-3, atol=2e-4)


def test_equal_names_give_equal_courses():
    for first, second in zip(course([1, 2], Settings()), course([1, 2], Settings()), strict=True):
        assert torch.equal(first, second)


@pytest.mark.parametrize("family", ["gaussian", "mixture"])
def test_factors_stay_triangular_with_a_positive_diagonal(family):
    settings = Settings(family=family, lambda_=1e-3, sigma_min=1e-3)
    mu, L, _ = course([0, 1], settings)
    assert torch.isfinite(mu).all()
    assert not L.triu(1).any()
    assert (L.diagonal(dim1=-2, dim2=-1) >= 1e-3).all()


# --- bad input ----------------------------------------------------------------------------------

BAD_SETTINGS = [
    ("lambda_", -1e-6), ("lambda_", math.nan), ("lambda_", math.inf),
    ("psi", -0.1), ("psi", 1.5), ("psi", math.nan),
    ("gamma", -0.1), ("gamma", 1.0), ("gamma", math.nan),
    ("components", 0), ("components", -1), ("components", 1.5),
    ("batch", 0), ("buffer", 0), ("weights", 0), ("weights", 2.0),
    ("kappa", 0.0), ("kappa", math.inf), ("alpha_mu", 0.0), ("alpha_L", -0.1),
    ("sigma_p2", 0.0), ("sigma_p2", math.nan), ("sigma_min", 0.0),
    ("family", "student"), ("init", "zero"), ("act", "never"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "value"), BAD_SETTINGS)
def test_settings_out_of_range_are_refused_by_name(name, value):
    with pytest.raises(ValueError) as error:
        Settings(**{name: value})
    message = str(error.value)
    assert name in message
    assert str(value) in message
    assert "\n" not in message


def test_a_gaussian_has_one_component():
    with pytest.raises(ValueError, match="1 component, got 3"):
        Settings(family="gaussian", components=3)


@pytest.mark.parametrize("shape", [(2, 0, 6), (0, 3, 6), (2, 3, 7), (3, 6), (6,), (1, 2, 3, 6)])
def test_sources_of_another_shape_are_refused(shape):
    with pytest.raises(ValueError, match="sources must have shape"):
        check_sources(torch.zeros(shape), 6)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_sources_must_be_finite(value):
    sources = torch.zeros(2, 3, 6)
    sources[1, 2, 4] = value
    with pytest.raises(ValueError, match="sources must be finite"):
        check_sources(sources, 6)


@pytest.mark.parametrize("dtype", [torch.float64, torch.int64])
def test_sources_must_be_single_precision(dtype):
    with pytest.raises(ValueError, match="float32"):
        check_sources(torch.zeros(2, 3, 6, dtype=dtype), 6)


def test_bad_sources_stop_the_agent_before_it_starts():
    with pytest.raises(ValueError, match="at least 1 source"):
        VariationalTransfer(Linear(2, 3), torch.zeros(2, 0, 6), 2, Settings(), *streams([0, 1]))


def test_runs_taken_a_few_at_a_time_have_the_same_gradients(monkeypatch):
    q, runs, samples, size = MLP((2, 7, 3)), 5, 4, 6
    g = torch.Generator().manual_seed(0)
    batch = Transition(
        torch.randn(runs, size, 2, generator=g),
        torch.randint(3, (runs, size), generator=g),
        torch.randn(runs, size, generator=g),
        torch.randn(runs, size, 2, generator=g),
        torch.rand(runs, size, generator=g) < 0.3,
    )
    w = torch.randn(runs, samples, q.d, generator=g)
    together = td_gradients(q, w, batch, 0.5, 0.99, 10.0)
    for limit in (1, 2 * samples * 2 * size * q.width):
        monkeypatch.setattr(transfer, "CACHED", limit)
        torch.testing.assert_close(td_gradients(q, w, batch, 0.5, 0.99, 10.0), together)
