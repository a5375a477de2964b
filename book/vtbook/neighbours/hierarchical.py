"""Hierarchical Bayes over source weights: what a new task's weights are, predicted from them."""

import torch
from attrs import frozen
from scipy.optimize import brentq
from torch import Tensor

from vtlib.priors import GaussianPrior, low_rank_precision
from vtlib.transfer import Settings

KAPPA0 = 1e-2  # how many sources the guess is worth that weights are zero on average


@frozen
class HierarchicalSettings(Settings):
    """Variational transfer from the predictive law of a normal-inverse-Wishart model.

    Parameters are those of a Gaussian posterior, whose ``jitter`` and ``ddof`` have no use here.
    """

    def prior(self, sources: Tensor) -> GaussianPrior:
        """The prior learned from sources (R, S, d)."""
        return PredictivePrior(sources)


class PredictivePrior(GaussianPrior):
    """The Gaussian with mean and covariance of the predictive law of the next source's weights.

    Sources (R, S, d) are N(m, Sigma) each, with (m, Sigma) normal-inverse-Wishart around zero:
    kappa_0 = 0.01, nu_0 = d + 2, Psi_0 = psi I, so that psi I is Sigma's mean. psi maximises the
    evidence of a run's sources. The predictive law is Student's, of mean
    S w / (kappa_0 + S), w the sources' mean, and covariance
    c (psi I + sum_j (w_j - w)(w_j - w)^T + kappa_0 S / (kappa_0 + S) w w^T),
    c = (kappa_n + 1) / (kappa_n (S + 1)). Sources: Lazaric and Ghavamzadeh (2010); Murphy (2007),
    section 9.
    """

    def __init__(self, sources: Tensor) -> None:
        scatter, count = scatter_of(sources), sources.shape[-2]
        psi = torch.stack([evidence_psi(run) for run in scatter]).view(-1, 1, 1)
        kappa = KAPPA0 + count
        scale = (kappa + 1) / (kappa * (count + 1))
        self.mu = sources.mean(-2, keepdim=True) * (count / kappa)
        self._spread, self._jitter = scatter * scale**0.5, scale * psi
        self.precision = low_rank_precision(self._spread, self._jitter)


def scatter_of(sources: Tensor) -> Tensor:
    """Columns (R, d, S + 1) whose outer products sum to the scatter that sources add to Psi_0."""
    count, mean = sources.shape[-2], sources.mean(-2, keepdim=True)
    away = (KAPPA0 * count / (KAPPA0 + count)) ** 0.5
    return torch.cat([sources - mean, away * mean], -2).mT


def evidence_psi(scatter: Tensor) -> Tensor:
    """The psi that maximises the log-evidence of sources, from their scatter (d, S + 1).

    Up to what psi does not change, it is
    -(S d / 2) log psi - (nu_n / 2) sum_i log(1 + e_i / psi), with e_i the scatter's eigenvalues and
    nu_n = d + 2 + S; its slope changes sign once.
    """
    d, count = scatter.shape[0], scatter.shape[1] - 1
    e = torch.linalg.svdvals(scatter.double()).square().cpu().numpy()

    def slope(log_psi: float) -> float:
        psi = 10**log_psi
        return float((d + 2 + count) * (e / (psi + e)).sum() - count * d)

    return scatter.new_tensor(10 ** brentq(slope, -12, 12))
