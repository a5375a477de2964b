"""Priors over Q-function weights, learned from sources: a Gaussian, or a mixture of them.

Both give the same to a posterior: where to start, the precision that its factor L is pulled by, and
the gradient of the divergence with respect to its means.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

PRIOR_JITTER = 1e-4  # added to the covariance of the Gaussian prior, so that it has an inverse
SPAN_JITTER = 1e-8  # the same for a posterior that starts within the span of the sources
MAX_UPDATES = 50  # of the responsibilities' fixed point
TOLERANCE = 1e-6
DOUBLES = 2**22  # doubles in the matrices that are factored at a time


class Gaussian(NamedTuple):
    """A Gaussian by its mean mu (..., d) and lower-triangular Cholesky factor (..., d, d)."""

    mu: Tensor
    scale_tril: Tensor


class Precision(NamedTuple):
    """A precision matrix scale * (I - W W^T), with W (..., d, r) of few columns, or None."""

    scale: float
    W: Tensor | None = None

    def times(self, x: Tensor) -> Tensor:
        """The product with the columns of x (..., d, k)."""
        if self.W is None:
            return self.scale * x
        return self.scale * (x - self.W @ (self.W.transpose(-1, -2) @ x))

    def diagonal(self, d: int) -> Tensor:
        """The diagonal, (..., d)."""
        if self.W is None:
            return torch.full((d,), self.scale)
        return self.scale * (1 - self.W.square().sum(-1))


class Start(NamedTuple):
    """Where a posterior starts: C Gaussians for each run, which share one covariance.

    mu: (R, C, d). The covariance is B B^T + variance * I, with B (R, d, S) or None for no spread.
    """

    mu: Tensor
    variance: float
    spread: Tensor | None = None


class GaussianPrior:
    """N(mu_p, Sigma_p), fitted to sources (R, S, d) by eqs. 5.5 and 5.6, with jitter * I added.

    The covariance is a sum over S - ddof. Raises ValueError when there are no more sources than
    ddof, or when they are so far apart that rounding spoils the covariance.
    """

    def __init__(self, sources: Tensor, jitter: float = PRIOR_JITTER, ddof: int = 0) -> None:
        mu, self._spread = sources_mean_and_spread(sources, ddof)
        self.mu = mu.unsqueeze(1)
        self._jitter = jitter
        self.precision = low_rank_precision(self._spread, jitter)

    def start(self, components: int, init: str) -> Start:
        """The prior itself ("sources"), the minimiser of the KL, or the "span" of the sources."""
        variance = SPAN_JITTER if init == "span" else self._jitter
        return Start(self.mu.clone(), variance, self._spread)

    def pull(self, mu: Tensor) -> Tensor:
        """Gradient (R, C, d) of the KL with respect to the means (R, C, d), eq. 5.8."""
        return self.precision.times((mu - self.mu).transpose(1, 2)).transpose(1, 2)


class MixturePrior:
    """Equally weighted N(w_j, variance * I) around sources w_j, (R, S, d), section 5.2.2.

    The KL is replaced by its bound of eq. 5.13. responsibilities: "exact", those that tighten the
    bound, or "equal" for all sources.
    """

    def __init__(self, sources: Tensor, variance: float, responsibilities: str = "exact") -> None:
        self._sources, self._variance = sources, variance
        self._equal = responsibilities == "equal"
        self.precision = Precision(1 / variance)

    def start(self, components: int, init: str) -> Start:
        """C different "sources", the minimiser of the bound, or the "mean" for all components."""
        if init == "sources":
            count = self._sources.shape[1]
            mu = self._sources[:, torch.arange(components) % count].clone()
        else:
            mu = self._sources.mean(1, keepdim=True).repeat(1, components, 1)
        return Start(mu, self._variance)

    def pull(self, mu: Tensor) -> Tensor:
        """Gradient (R, C, d) of the tightened bound with respect to the means (R, C, d)."""
        if self._equal:
            toward = mu - self._sources.mean(1, keepdim=True)
            return toward / (self._variance * mu.shape[1])
        # what a component's own covariance adds to its KLs is the same for every source, and
        # cancels from eq. 5.15
        differences = _differences(mu, self._sources)
        log_theta, _ = responsibilities((differences * differences).sum(-1) / (2 * self._variance))
        pull = log_theta.exp().to(mu.dtype).unsqueeze(-2) @ differences
        return pull.squeeze(-2) / self._variance


def sources_mean_and_spread(sources: Tensor, ddof: int = 0) -> tuple[Tensor, Tensor]:
    """Mean mu_p (..., d) of eq. 5.5, and B (..., d, S) with B B^T the covariance of eq. 5.6.

    sources: (..., S, d) weights of S source tasks; the covariance's sum is divided by S - ddof.
    Raises ValueError when that is not positive.
    """
    freedom = sources.shape[-2] - ddof
    if freedom < 1:
        raise ValueError(f"sources must be more than ddof = {ddof}, got {sources.shape[-2]}")
    mu = sources.mean(-2)
    spread = (sources - mu.unsqueeze(-2)).transpose(-1, -2) / freedom**0.5
    return mu, spread


def covariance_factor(spread: Tensor, jitter: float) -> Tensor:
    """Cholesky factor of B B^T + jitter * I, B (..., d, S); ValueError when rounding spoils it."""
    *batch, d, count = spread.shape
    factors = spread.new_empty(*batch, d, d)
    # Matrices are factored a few at a time, because all of them in double precision would take
    # several times the memory. The number is even, because the last digit of a result depends on
    # where in 16 bytes a matrix begins.
    size = 2 * max(1, DOUBLES // d**2 // 2)
    parts = factors.view(-1, d, d).split(size)
    spreads = spread.reshape(-1, d, count).split(size)
    try:
        for narrow, part in zip(spreads, parts, strict=True):
            wide = narrow.double()
            covariance = wide @ wide.mT
            covariance.diagonal(dim1=-2, dim2=-1).add_(jitter)
            part.copy_(torch.linalg.cholesky(covariance, out=covariance))
    except torch.linalg.LinAlgError as error:  # type: ignore[attr-defined]  # documented, not typed
        raise too_far_apart(spread) from error
    if not all(extreme.isfinite() for extreme in torch.aminmax(factors)):
        raise too_far_apart(spread)
    return factors


def low_rank_precision(spread: Tensor, jitter: float) -> Precision:
    """Inverse of B B^T + jitter * I, B (..., d, S), never d x d; ValueError as of its factor."""
    try:
        left, singular, _ = torch.linalg.svd(spread.double(), full_matrices=False)
    except torch.linalg.LinAlgError as error:  # type: ignore[attr-defined]  # documented, not typed
        raise too_far_apart(spread) from error
    shrink = (singular**2 / (singular**2 + jitter)).sqrt()
    W = (left * shrink.unsqueeze(-2)).to(spread.dtype)
    if not W.isfinite().all():  # the decomposition of an infinite spread may raise nothing
        raise too_far_apart(spread)
    return Precision(1 / jitter, W)


def too_far_apart(spread: Tensor) -> ValueError:
    """What refuses sources of that spread (..., d, S)."""
    distance = float(spread.abs().amax()) * spread.shape[-1] ** 0.5
    return ValueError(
        "sources must lie closer to their mean for a gaussian posterior, whose covariance rounding "
        f"spoils, got weights that are {distance:g} away"
    )


def kl(q: Gaussian, p: Gaussian) -> Tensor:
    """KL(q || p) of two Gaussians, eq. 5.7; batch axes broadcast, returns (...)."""
    whitened = torch.linalg.solve_triangular(p.scale_tril, q.scale_tril, upper=False)
    distance = (q.mu - p.mu).unsqueeze(-1)
    shift = torch.linalg.solve_triangular(p.scale_tril, distance, upper=False)
    log_volumes = _log_diagonal(p.scale_tril) - _log_diagonal(q.scale_tril)
    squares: Tensor = whitened.square().sum((-2, -1)) + shift.square().sum((-2, -1))
    return log_volumes + 0.5 * (squares - q.mu.shape[-1])


def _log_diagonal(factor: Tensor) -> Tensor:
    """Half the log-determinant of L L^T."""
    return factor.diagonal(dim1=-2, dim2=-1).log().sum(-1)


def responsibilities(pairwise: Tensor) -> tuple[Tensor, Tensor]:
    """log(theta) and log(phi) that tighten the bound of eq. 5.13, by eqs. 5.14 and 5.15.

    pairwise: (..., C, S), the KL of posterior component i from prior component j, both mixtures
    equally weighted. Runs from uniform phi to convergence in logarithms: the KLs reach 1e6 and
    exp(-KL) would vanish. Both results are float64 of shape (..., C, S); theta sums to 1/C over j,
    phi to 1/S over i. Source: Hershey and Olsen (2007).
    """
    # distances of 1e6 leave float32 no digits for the logarithms' differences
    pairwise = pairwise.double()
    components, sources = pairwise.shape[-2:]
    log_phi = pairwise.new_full(pairwise.shape, -math.log(components * sources))
    log_theta = _theta(log_phi, pairwise)
    moving = torch.ones_like(pairwise[..., :1, :1], dtype=torch.bool)
    # with one component phi is fixed by its constraint, and theta is exact at once
    for _ in range(MAX_UPDATES if components > 1 else 0):
        new_phi = log_theta - log_theta.logsumexp(-2, keepdim=True) - math.log(sources)
        new_theta = _theta(new_phi, pairwise)
        # each run stops by itself, so that its numbers do not depend on its neighbours
        log_phi = torch.where(moving, new_phi, log_phi)
        change = (new_theta.exp() - log_theta.exp()).abs().amax((-2, -1), keepdim=True)
        log_theta = torch.where(moving, new_theta, log_theta)
        moving = moving & (change >= TOLERANCE)
        if not moving.any():
            break
    return log_theta, log_phi


def _theta(log_phi: Tensor, pairwise: Tensor) -> Tensor:
    return torch.log_softmax(log_phi - pairwise, -1) - math.log(pairwise.shape[-2])


def kl_bound(pairwise: Tensor, log_theta: Tensor, log_phi: Tensor) -> Tensor:
    """The upper bound (...) of eq. 5.13 on the KL of two mixtures, from tables (..., C, S)."""
    theta = log_theta.exp()
    # theta = 0 contributes nothing even where phi = 0 makes the logarithms infinite
    terms = theta * (log_theta - log_phi + pairwise)
    return torch.where(theta > 0, terms, 0.0).sum((-2, -1))


def pairwise_kl(q: Gaussian, sources: Tensor, variance: float) -> Tensor:
    """KL (..., C, S) of q (..., C, d) from N(w_j, variance * I) at sources (..., S, d), eq. 5.7."""
    d = q.mu.shape[-1]
    trace = q.scale_tril.square().sum((-2, -1)) / variance
    shape = 0.5 * (d * math.log(variance) - 2 * _log_diagonal(q.scale_tril) + trace - d)
    squares = _differences(q.mu, sources).square_().sum(-1)
    return shape.unsqueeze(-1) + squares / (2 * variance)


def _differences(mu: Tensor, sources: Tensor) -> Tensor:
    # expanding the square instead would lose the digits that a variance of 1e-5 needs
    return mu.unsqueeze(-2) - sources.unsqueeze(-3)
