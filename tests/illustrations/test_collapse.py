"""The corridor and its exact posteriors: against quadrature, evidence, and the gradients of 5.2."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch.distributions import MultivariateNormal

from vtlib.gaussian import Gaussian, Precision, kl_gradients
from vtlib.illustrations.collapse import (
    BASES,
    COUNTS,
    GAMMA,
    LAMBDA,
    LENGTH,
    SLOW,
    SOURCE_MUD,
    TARGET_MUD,
    collapse_picture,
    features,
    gibbs,
    mean_error,
    next_position,
    priors,
    remaining_time,
    source_weights,
    value,
    walk,
)

GRID = torch.linspace(0, LENGTH, 501, dtype=torch.float64)


@pytest.fixture(scope="module")
def data():
    return walk(256, np.random.default_rng(1))


@pytest.fixture(scope="module")
def sources():
    return source_weights()


def random_case(seed: int, d: int, n: int, components: int = 1):
    g = torch.Generator().manual_seed(seed)
    mu, x, r = (torch.randn(s, generator=g).double() for s in ((components, d), (n, d), (n,)))
    lower = torch.randn(d, d, generator=g).double().tril(-1) * 0.3
    return Gaussian(mu, lower + torch.eye(d).double()), x, r


@pytest.mark.parametrize("mud", [1.5, 5.2, 8.5])
def test_time_falls_by_one_with_each_step(mud):
    before, after = remaining_time(GRID, mud), remaining_time(next_position(GRID, mud), mud)
    torch.testing.assert_close(after, (before - 1).clamp(min=0))
    assert float(before[0]) == pytest.approx(LENGTH + 2 * (1 / SLOW - 1))
    assert float(before[-1]) == 0


def test_the_walker_is_slow_in_the_mud_only():
    at = torch.tensor([0.5, 5.2, 8.0], dtype=torch.float64)
    torch.testing.assert_close(next_position(at, 5.2) - at, torch.tensor([1, SLOW, 1]).double())


def test_true_values_obey_the_bellman_equation():
    onward = next_position(GRID, TARGET_MUD)
    inside = onward < LENGTH
    torch.testing.assert_close(
        value(GRID, TARGET_MUD)[inside], GAMMA * value(onward, TARGET_MUD)[inside]
    )


def test_sources_represent_their_values(sources):
    for w, mud in zip(sources, SOURCE_MUD, strict=True):
        assert (features(GRID) @ w - value(GRID, mud)).abs().max() < 0.015


def test_transitions_are_those_of_the_walk(data):
    positions, x, r = data
    ended = r > 0
    assert (remaining_time(positions, TARGET_MUD)[ended] <= 1).all()
    assert (positions[1:][ended[:-1]] < 1).all()
    going = ~ended[:-1]
    torch.testing.assert_close(
        positions[1:][going], next_position(positions[:-1], TARGET_MUD)[going]
    )
    onward = features(next_position(positions, TARGET_MUD)) * (~ended).double().unsqueeze(1)
    torch.testing.assert_close(x, features(positions) - GAMMA * onward)
    shorter = walk(40, np.random.default_rng(1))
    assert all(torch.equal(a[:40], b) for a, b in zip(data, shorter, strict=True))


def test_without_data_the_posterior_is_the_prior(sources):
    _, x, r = walk(0, np.random.default_rng(0))
    for prior in priors(sources).values():
        found = gibbs(prior, x, r, LAMBDA)
        torch.testing.assert_close(found.mu, prior.mu)
        torch.testing.assert_close(found.covariance, prior.L @ prior.L.T)
        torch.testing.assert_close(
            found.log_weights.exp(), torch.full((len(prior.mu),), 1 / len(prior.mu)).double()
        )


def test_posterior_of_one_weight_by_quadrature():
    prior, x, r = random_case(0, 1, 3, components=2)
    lambda_ = 0.7
    w = torch.linspace(-12, 12, 40_001, dtype=torch.float64)
    losses = (r.unsqueeze(1) - x * w).square().mean(0)
    pairs = [MultivariateNormal(mu, prior.L @ prior.L.T) for mu in prior.mu]
    density = sum(p.log_prob(w.unsqueeze(1)).exp() for p in pairs) * torch.exp(
        -len(r) / lambda_ * losses
    )
    density = density / torch.trapezoid(density, w)
    mean = torch.trapezoid(w * density, w)
    second = torch.trapezoid(w**2 * density, w)
    found = gibbs(prior, x, r, lambda_)
    share = found.log_weights.exp()
    assert float(share @ found.mu[:, 0]) == pytest.approx(float(mean), abs=1e-8)
    ours = share @ (found.mu[:, 0] ** 2 + found.covariance[0, 0])
    assert float(ours) == pytest.approx(float(second), abs=1e-8)


def test_weights_are_the_evidence_of_each_component():
    prior, x, r = random_case(1, 4, 6, components=3)
    spread = x @ prior.L @ prior.L.T @ x.T + 0.35 * torch.eye(6).double()
    logs = torch.stack([MultivariateNormal(x @ mu, spread).log_prob(r) for mu in prior.mu])
    torch.testing.assert_close(gibbs(prior, x, r, 0.7).log_weights, torch.log_softmax(logs, 0))


def test_gradients_of_the_objective_vanish_at_the_posterior():
    # eq. 5.2 with a Gaussian family that contains the optimum: eqs. 5.8 to 5.11 must cancel there
    d, n, lambda_ = 5, 7, 0.4
    _, x, r = random_case(2, d, n)
    prior = Gaussian(torch.randn(1, d, generator=torch.Generator().manual_seed(3)).double(), None)
    prior = prior._replace(L=1.5 * torch.eye(d).double())
    found = gibbs(prior, x, r, lambda_)
    q = Gaussian(found.mu[0], torch.linalg.cholesky(found.covariance))
    of_kl = kl_gradients(q, prior.mu[0], Precision(1 / 1.5**2))
    # the squared TD errors are quadratic in w, so both expectations are known
    td_mu = -2 / n * x.T @ (r - x @ q.mu)
    td_L = (2 / n * x.T @ x @ q.L).tril()
    torch.testing.assert_close(td_mu, -lambda_ / n * of_kl[0])
    torch.testing.assert_close(td_L, -lambda_ / n * of_kl[1], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("family", ["GVT", "MGVT"])
def test_the_posterior_closes_in_on_the_target(sources, data, family):
    _, x, r = data
    found = {n: gibbs(priors(sources)[family], x[:n], r[:n], LAMBDA) for n in (0, 16, 256)}
    assert mean_error(found[256]) < mean_error(found[16]) < 0.5 * mean_error(found[0])
    spreads = [
        float((features(GRID) @ f.covariance * features(GRID)).sum()) for f in found.values()
    ]
    assert spreads[0] > spreads[1] > spreads[2] > 0


def test_kernels_name_the_source_nearest_to_the_target(sources, data):
    _, x, r = data
    found = gibbs(priors(sources)["MGVT"], x[:16], r[:16], LAMBDA)
    assert SOURCE_MUD[int(found.log_weights.argmax())] == 5.5
    assert float(found.log_weights.max().exp()) > 0.9


def test_pictures_tell_their_count_and_errors(sources, data):
    assert priors(sources)["GVT"].L.shape == (BASES, BASES)
    for count in (COUNTS[0], COUNTS[3]):
        _, x, r = (part[:count] for part in data)
        error = mean_error(gibbs(priors(sources)["GVT"], x, r, LAMBDA))
        html = collapse_picture(sources, data, count)
        assert f"N = {count} transitions" in html
        assert f"at most {error:.3f} with one Gaussian" in html
