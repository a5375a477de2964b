"""The predictive prior: its evidence and its moments against SciPy's multivariate t."""

import numpy as np
import pytest
import torch
from scipy.stats import multivariate_t

from vtbook.neighbours import HierarchicalSettings
from vtbook.neighbours.hierarchical import KAPPA0, PredictivePrior, evidence_psi, scatter_of
from vtlib.posteriors import COVARIANCES, Descent
from vtlib.qfunctions import MLP
from vtlib.rng import Rng, Stream

Q, COUNT = MLP((1, 2)), 3
SOURCES = 0.3 + 0.2 * torch.randn(1, COUNT, Q.d, generator=torch.Generator().manual_seed(0))
PSI = float(evidence_psi(scatter_of(SOURCES)[0]))


def predictive(count, psi):
    """Mean, scale and degrees of freedom of the law after so many sources (Murphy 2007, 9)."""
    w = SOURCES[0, :count].double().numpy()
    kappa, freedom = KAPPA0 + count, count + 3
    mean = w.sum(0) / kappa
    Psi = psi * np.eye(Q.d) + w.T @ w - kappa * np.outer(mean, mean)
    return mean, Psi * (kappa + 1) / (kappa * freedom), freedom


def log_evidence(psi):
    """Each source by the law that the ones before it predict."""
    laws = [multivariate_t(*predictive(count, psi)) for count in range(COUNT)]
    return sum(law.logpdf(w) for law, w in zip(laws, SOURCES[0].double().numpy(), strict=True))


def test_psi_maximises_the_evidence():
    for factor in (0.2, 0.8, 0.97, 1.03, 1.25, 5.0):
        assert log_evidence(factor * PSI) < log_evidence(PSI)


def test_the_prior_has_the_moments_of_the_predictive_law_and_variational_transfer_starts_there():
    mean, scale, freedom = predictive(COUNT, PSI)
    covariance = torch.from_numpy(scale * freedom / (freedom - 2)).float()
    agent = HierarchicalSettings(family="gaussian").agent(Q, SOURCES, 1, Rng("t", [0]))
    torch.testing.assert_close(agent.mu[0, 0], torch.from_numpy(mean).float())
    prior = PredictivePrior(SOURCES)
    start = prior.start(1, "sources")
    found = start.spread[0] @ start.spread[0].T + start.variance[0] * torch.eye(Q.d)
    torch.testing.assert_close(found, covariance, rtol=1e-4, atol=1e-6)
    inverse = prior.precision.times(torch.eye(Q.d).unsqueeze(0))[0]
    torch.testing.assert_close(inverse, covariance.inverse(), rtol=1e-3, atol=1e-2)


@pytest.mark.parametrize("divergence", ["full", "diagonal"])
def test_the_kernel_gives_each_run_its_own_scale(divergence):
    g = torch.Generator().manual_seed(2)
    sources = torch.randn(3, 4, 7, generator=g) * torch.tensor([0.1, 1.0, 5.0]).view(-1, 1, 1)
    prior, descent = PredictivePrior(sources), Descent(0.01, 1e-4, 1000.0, divergence)
    start = prior.start(1, "sources"), prior.precision, descent
    both = [COVARIANCES[x](*start, Stream("t", range(3), "z"), 4) for x in ("full", "dense")]
    for _ in range(30):
        torch.testing.assert_close(*(one.sample() for one in both), rtol=1e-4, atol=1e-4)
        gradients = torch.randn(3, 1, 3, 7, generator=g)
        for one in both:
            one.step(gradients, 0.05)
    torch.testing.assert_close(*(one.scale_tril for one in both), rtol=1e-3, atol=1e-4)
