"""The sampled KL of mixtures against quadrature, and the bound against both."""

from __future__ import annotations

import numpy as np
import torch

from vtlib.illustrations import mixture_kl
from vtlib.illustrations.mixture_kl import PLACES, PRIOR


def test_sampled_kl_agrees_with_quadrature_and_the_bound_lies_above():
    x = torch.linspace(-9, 9, 20_001, dtype=torch.float64).unsqueeze(-1)
    q = mixture_kl.mixture(mixture_kl.means(PLACES), mixture_kl.DEVIATIONS)
    log_q = q.log_prob(x)
    exact = torch.trapezoid(log_q.exp() * (log_q - PRIOR.log_prob(x)), x, dim=0)
    estimates, errors = mixture_kl.sampled_kl(q, PRIOR, 4000, np.random.default_rng(3))
    standard = (estimates - exact) / errors
    assert standard.abs().max() < 4
    assert 0.5 < standard.std() < 1.5  # the stated errors are those made
    bound, theta, phi = mixture_kl.tightened(PLACES)
    assert (bound >= exact).all()
    torch.testing.assert_close(theta.sum(2), torch.full((len(PLACES), 2), 1 / 2).double())
    torch.testing.assert_close(phi.sum(1), torch.full((len(PLACES), 3), 1 / 3).double())
