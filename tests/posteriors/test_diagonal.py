"""Standard deviations without correlations: where they start, and where the KL alone leads."""

from __future__ import annotations

import pytest
import torch

from vtlib.posteriors import Descent
from vtlib.posteriors.diagonal import Diagonal
from vtlib.priors import Gaussian, GaussianPrior, covariance_factor, kl, sources_mean_and_spread
from vtlib.rng import Stream


@pytest.mark.parametrize("divergence", ["full", "diagonal"])
def test_the_best_diagonal_gaussian_is_the_start_and_what_the_kl_alone_leads_to(divergence):
    sources = torch.randn(3, 4, 6, generator=torch.Generator().manual_seed(1))
    prior, descent = GaussianPrior(sources, 0.2), Descent(0.01, 1e-4, 1000.0, divergence)
    stream = Stream("t", range(3), "posterior")
    posterior = Diagonal(prior.start(1, "sources"), prior.precision, descent, stream, 2)
    mean, start = posterior.mu, posterior.scale_tril.clone()
    p = Gaussian(mean, covariance_factor(sources_mean_and_spread(sources)[1], 0.2).unsqueeze(1))
    for i in range(6):
        for factor in (0.95, 1.05):
            other = start.clone()
            other[..., i, i] *= factor
            assert (kl(Gaussian(mean, other), p) > kl(Gaussian(mean, start), p)).all()
    for t in range(1000):
        z = (posterior.sample() - mean.unsqueeze(2))[:, :, 1:].sign()
        posterior.step(-z if t < 10 else 0 * z, 1.0)  # away, and back again
        if t == 9:
            assert ((posterior.scale_tril - start).diagonal(dim1=2, dim2=3) > 0.01).all()
    torch.testing.assert_close(posterior.scale_tril, start)
