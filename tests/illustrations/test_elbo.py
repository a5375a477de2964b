"""Evidence, ELBO and KL on a grid, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from vtlib import priors
from vtlib.illustrations import elbo

# A prior and an observation of y with noise of deviation 0.5: the posterior is a Gaussian.
CONJUGATE = (
    elbo.gaussian(0.4, 0.8),
    -0.5 * ((1.8 - elbo.Y) / 0.5) ** 2 - np.log(0.5 * np.sqrt(2 * np.pi)),
)
DEVIATION = (1 / 0.8**2 + 1 / 0.5**2) ** -0.5
MEAN = DEVIATION**2 * (0.4 / 0.8**2 + 1.8 / 0.5**2)


def test_a_conjugate_problem_has_its_known_evidence_posterior_and_tight_bound():
    variance = 0.8**2 + 0.5**2
    total = -0.5 * (1.8 - 0.4) ** 2 / variance - 0.5 * np.log(2 * np.pi * variance)
    assert elbo.log_evidence(*CONJUGATE) == pytest.approx(total)
    exact = elbo.gaussian(MEAN, DEVIATION)
    np.testing.assert_allclose(elbo.log_posterior(*CONJUGATE), exact, rtol=1e-9)
    around = MEAN + np.array([-0.1, 0, 0.1]), [0.3, 0.6, DEVIATION]
    assert elbo.best_gaussian(*CONJUGATE, *around) == pytest.approx((total, MEAN, DEVIATION))


@pytest.mark.parametrize("mean", [-1.3, 0.0, 0.7])
@pytest.mark.parametrize("deviation", [0.15, 0.3, 0.9])
def test_elbo_and_kl_add_up_to_the_evidence(page, mean: float, deviation: float):
    problem = page("background")["prior"], page("background")["likelihood"]
    log_q = elbo.gaussian(mean, deviation)
    gap = elbo.kl(log_q, elbo.log_posterior(*problem))
    assert gap > 0.1
    assert elbo.elbo(*problem, log_q) + gap == pytest.approx(elbo.log_evidence(*problem), abs=1e-9)


def test_kl_is_that_of_gaussians():
    pairs = ((0.5, 0.8), (-0.4, 1.1))
    exact = priors.kl(*(priors.Gaussian(torch.tensor([m]), torch.tensor([[s]])) for m, s in pairs))
    assert elbo.kl(*(elbo.gaussian(*pair) for pair in pairs)) == pytest.approx(
        float(exact), abs=1e-6
    )
