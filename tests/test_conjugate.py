"""The exact posterior of the regression, and the learned one beside it."""

from __future__ import annotations

import numpy as np
import torch

from vtlib.experiments.conjugate import (
    INPUTS,
    RUNS,
    Regression,
    conjugate_figure,
    distances,
    regression,
)
from vtlib.gaussian import Gaussian, kl, sources_mean_and_spread
from vtlib.transfer import PRIOR_JITTER, Settings

LAMBDA = 3.0


def objective(task: Regression, q: Gaussian, count: int, prior: Gaussian) -> torch.Tensor:
    """Eq. 5.2 after some transitions, in closed form for errors linear in the weights."""
    x = torch.cat([task.obs, torch.ones(RUNS, len(task.obs[0]), 1)], -1)[:, :count].double()
    error = task.reward[:, :count].double() - (x @ q.mu.unsqueeze(-1)).squeeze(-1)
    spread = (x @ q.L).square().sum(-1)
    return (error.square() + spread).mean(1) + LAMBDA / count * kl(q, prior)


def test_the_exact_posterior_minimises_the_objective():
    task, count = regression(12), 12
    mean, spread = sources_mean_and_spread(task.sources.double())
    covariance = spread @ spread.mT + PRIOR_JITTER * torch.eye(INPUTS + 1)
    prior = Gaussian(mean, torch.linalg.cholesky(covariance))
    best = task.exact(count, LAMBDA)
    least = objective(task, best, count, prior)
    g = torch.Generator().manual_seed(0)
    for size in (1e-3, 1e-1):
        for _ in range(20):
            move = size * torch.randn(RUNS, INPUTS + 1, generator=g, dtype=torch.float64)
            turn = size * torch.randn(RUNS, INPUTS + 1, INPUTS + 1, generator=g).double().tril()
            for other in (
                Gaussian(best.mu + move, best.L),
                Gaussian(best.mu, best.L + best.L * turn),
            ):
                assert (objective(task, other, count, prior) > least).all()


def test_learning_comes_close_and_data_do_not_depend_on_their_number():
    at = (1, 300)
    found = distances(Settings("gaussian", lambda_=10.0, alpha_mu=1e-2, alpha_L=1e-2), at)
    assert found.shape == (RUNS, len(at))
    assert (found[:, 1] < 1.0).all()
    assert torch.equal(regression(5).obs, regression(5).obs)


def test_the_figure_names_the_step_sizes():
    at = (1, 2, 3)
    found = np.random.default_rng(0).random((RUNS, 3))
    figure = conjugate_figure(at, [(0.1, found), (0.01, found), (0.001, found)])
    labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert [label.split("= ")[1] for label in labels] == ["0.1", "0.01", "0.001"]
