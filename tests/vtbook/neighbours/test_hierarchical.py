"""The predictive prior: its evidence and its moments against plain formulas."""

from __future__ import annotations

import math

import pytest
import torch

from vtbook.neighbours import HierarchicalSettings
from vtbook.neighbours.hierarchical import KAPPA0, PredictivePrior, evidence_psi, scatter_of
from vtlib.posteriors import COVARIANCES, Descent
from vtlib.qfunctions import MLP
from vtlib.rng import Rng, Stream
from vtlib.transfer import VariationalTransfer

D, COUNT = 4, 3
SOURCES = 0.3 + 0.2 * torch.randn(1, COUNT, D, generator=torch.Generator().manual_seed(0))


def niw(sources, psi):
    """kappa_n, nu_n, mu_n, Psi_n of a normal-inverse-Wishart model (Murphy 2007, section 9)."""
    w, mean = sources.double(), sources.double().mean(0)
    kappa, nu = KAPPA0 + COUNT, D + 2 + COUNT
    scatter = (w - mean).T @ (w - mean)
    away = KAPPA0 * COUNT / kappa * torch.outer(mean, mean)
    return kappa, nu, COUNT * mean / kappa, psi * torch.eye(D).double() + scatter + away


def evidence(sources, psi):
    kappa, nu, _, Psi = niw(sources, psi)
    start = D + 2
    return (
        -COUNT * D / 2 * math.log(math.pi)
        + float(
            torch.mvlgamma(torch.tensor(nu / 2), D) - torch.mvlgamma(torch.tensor(start / 2), D)
        )
        + start / 2 * D * math.log(psi)
        - nu / 2 * float(torch.logdet(Psi))
        + D / 2 * math.log(KAPPA0 / kappa)
    )


def test_psi_maximises_the_evidence():
    psi = float(evidence_psi(scatter_of(SOURCES)[0]))
    best = evidence(SOURCES[0], psi)
    for factor in (0.2, 0.8, 0.97, 1.03, 1.25, 5.0):
        assert evidence(SOURCES[0], factor * psi) < best


def test_the_evidence_is_the_product_of_predictive_densities():
    psi, total = 0.1, 0.0
    for at in range(COUNT):  # each source by the multivariate t that the ones before it predict
        before = SOURCES[0, :at].double()
        mean = before.mean(0) if at else torch.zeros(D).double()
        kappa, nu = KAPPA0 + at, D + 2 + at
        Psi = psi * torch.eye(D).double() + (before - mean).T @ (before - mean)
        Psi += KAPPA0 * at / kappa * torch.outer(mean, mean)
        freedom = nu - D + 1
        scale = Psi * (kappa + 1) / (kappa * freedom)
        apart = SOURCES[0, at].double() - at * mean / kappa
        square = float(apart @ torch.linalg.solve(scale, apart))
        total += (
            math.lgamma((freedom + D) / 2)
            - math.lgamma(freedom / 2)
            - D / 2 * math.log(freedom * math.pi)
            - 0.5 * float(torch.logdet(scale))
            - (freedom + D) / 2 * math.log1p(square / freedom)
        )
    assert total == pytest.approx(evidence(SOURCES[0], psi))


def test_the_prior_has_the_moments_of_the_predictive_law():
    prior, psi = PredictivePrior(SOURCES), float(evidence_psi(scatter_of(SOURCES)[0]))
    kappa, nu, mean, Psi = niw(SOURCES[0], psi)
    covariance = Psi * (kappa + 1) / (kappa * (nu - D - 1))  # of a t: scale nu' / (nu' - 2)
    torch.testing.assert_close(prior.mu[0, 0], mean.float())
    start = prior.start(1, "sources")
    found = start.spread[0] @ start.spread[0].T + start.variance[0] * torch.eye(D)
    torch.testing.assert_close(found, covariance.float(), rtol=1e-4, atol=1e-6)
    inverse = prior.precision.times(torch.eye(D).unsqueeze(0))[0]
    torch.testing.assert_close(inverse, covariance.inverse().float(), rtol=1e-3, atol=1e-2)


def test_variational_transfer_runs_from_it():
    q = MLP((1, 2))
    agent = HierarchicalSettings(family="gaussian").agent(q, SOURCES, 1, Rng("t", [0]))
    assert isinstance(agent, VariationalTransfer)
    torch.testing.assert_close(agent.mu, PredictivePrior(SOURCES).mu)


@pytest.mark.parametrize("divergence", ["full", "diagonal"])
def test_the_kernel_gives_each_run_its_own_scale(divergence):
    runs, d = 3, 7
    sources = torch.randn(runs, 4, d, generator=torch.Generator().manual_seed(2))
    sources *= torch.tensor([0.1, 1.0, 5.0]).view(-1, 1, 1)
    prior = PredictivePrior(sources)
    assert prior.precision.scale.shape == (runs, 1, 1)
    descent = Descent(0.01, 1e-4, 1000.0, divergence)
    ours, plain = (
        COVARIANCES[x](
            prior.start(1, "sources"), prior.precision, descent, Stream("t", range(3), "z"), 4
        )
        for x in ("full", "dense")
    )
    for t in range(30):
        torch.testing.assert_close(ours.sample(), plain.sample(), rtol=1e-4, atol=1e-4)
        gradients = torch.randn(runs, 1, 3, d, generator=torch.Generator().manual_seed(t))
        for one in (ours, plain):
            one.step(gradients, 0.05)
    torch.testing.assert_close(ours.scale_tril, plain.scale_tril, rtol=1e-3, atol=1e-4)
