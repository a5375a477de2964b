"""The exact posterior of the regression, and the learned one beside it."""

from __future__ import annotations

import numpy as np
import torch

from vtlib.experiments import conjugate
from vtlib.experiments.conjugate import (
    BAYES,
    INPUTS,
    NOISE,
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


def test_the_minimiser_is_the_posterior_of_bayes_at_its_lambda():
    # one transition: p(w | r) of a Gaussian prior and a reward of known noise, by conditioning
    task = regression(1)
    mean, spread = sources_mean_and_spread(task.sources.double())
    prior = spread @ spread.mT + PRIOR_JITTER * torch.eye(INPUTS + 1)
    x = torch.cat([task.obs[:, 0], torch.ones(RUNS, 1)], -1).double().unsqueeze(-1)
    gain = prior @ x / (x.mT @ prior @ x + NOISE**2)
    error = task.reward[:, :1].double() - (mean.unsqueeze(1) @ x).squeeze(-1)
    found = task.exact(1, BAYES)
    torch.testing.assert_close(found.mu, mean + (gain @ error.unsqueeze(-1)).squeeze(-1))
    torch.testing.assert_close(found.L @ found.L.mT, prior - gain @ x.mT @ prior)


def test_learning_comes_close_and_data_do_not_depend_on_their_number():
    at = (1, 300)
    found = distances(Settings("gaussian", lambda_=10.0, alpha_mu=1e-2, alpha_L=1e-2), at)
    assert found.shape == (RUNS, len(at), 2)
    assert (found[:, 1].sum(-1) < 1.0).all()
    assert torch.equal(regression(5).obs, regression(9).obs[:, :5])


def test_the_parts_add_up_to_the_divergence(monkeypatch):
    pairs = []

    def noted(q: Gaussian, p: Gaussian) -> torch.Tensor:
        pairs.append((q, p))
        return kl(q, p)

    monkeypatch.setattr(conjugate, "kl", noted)
    found = distances(Settings("gaussian", lambda_=BAYES), (3,))
    (moved, exact), (centred, _) = pairs
    whole = kl(Gaussian(moved.mu, centred.L), exact)
    np.testing.assert_allclose(found[:, 0].sum(-1), whole, rtol=1e-9)
    off = (moved.mu - exact.mu).unsqueeze(-1)
    means = 0.5 * torch.linalg.solve_triangular(exact.L, off, upper=False).square().sum((1, 2))
    np.testing.assert_allclose(found[:, 0, 0], means, rtol=1e-9)


def test_the_figure_names_the_step_sizes():
    at = (1, 2, 3)
    found = np.random.default_rng(0).random((RUNS, 3, 2))
    sizes = [Settings("gaussian", alpha_L=alpha) for alpha in (0.1, 0.01, 0.001)]
    figure = conjugate_figure(at, [(each, found) for each in sizes])
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert [label.split("= ")[-1] for label in labels] == ["0.1", "0.01", "0.001"]
    lines = [ax.get_lines()[0].get_ydata() for ax in figure.axes]
    np.testing.assert_allclose(lines, np.log10(found).mean(0).T)
