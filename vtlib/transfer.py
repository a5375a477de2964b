"""Variational transfer (Algorithm 1): a posterior over Q weights, acted upon by Thompson sampling.

The posterior is a mixture of C equally weighted Gaussians; a single Gaussian with a Gaussian prior
is GVT (section 5.2.1), a mixture with one prior component per source is c-MGVT (section 5.2.2).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from vtlib.checks import (
    HUGE,
    check_between,
    check_kind,
    check_one_of,
    check_positive,
    check_weights,
    check_whole,
)
from vtlib.factor import CholeskyFactors
from vtlib.factor_deferred import DeferredFactors
from vtlib.factor_diagonal import DiagonalFactors
from vtlib.gaussian import (
    Gaussian,
    Precision,
    covariance_factor,
    low_rank_precision,
    sources_mean_and_spread,
)
from vtlib.mellow import check_psi, td_cotangent
from vtlib.mixture import pull_of_sources
from vtlib.qfunctions import QFunction
from vtlib.replay import ReplayBuffer, Transition
from vtlib.streams import Stream, check_runs

CLIP = 1000.0  # elementwise bound on every gradient
PRIOR_JITTER = 1e-4  # added to the covariance of the Gaussian prior, so that it has an inverse
CACHED = 1 << 20  # floats that may be in work at a time
LARGE = 1000  # weights from which on it pays to put off most of the update of L
SPAN_JITTER = 1e-8  # the same for a posterior that starts within the span of the sources

Factors = CholeskyFactors | DeferredFactors | DiagonalFactors
Cotangent = Callable[..., tuple[Tensor, Tensor]]  # as ``td_cotangent``


@dataclass(frozen=True)
class Settings:
    """Parameters of variational transfer, named as in the thesis (appendix A).

    family: "gaussian" (GVT) or "mixture" (MGVT) with ``components`` C. lambda_: weight of the KL
    (eq. 5.2). psi: share of the full gradient (eq. 5.4). weights: posterior samples per gradient
    and component. alpha_mu, alpha_L: step sizes of the means (Adam) and of L (SGD). sigma_p2:
    variance of the prior's components. sigma_min: least value on the diagonal of L. init: where the
    posterior starts: "sources" is the minimiser of the KL (the prior, or C different sources); a
    mixture may start with all components at their "mean", a Gaussian within their "span" (no
    variance but the sample's). act: draw weights at every "step" or once an "episode". covariance:
    "full", or "diagonal" for weights without correlations. Raises ValueError for a value outside
    its range.
    """

    family: str = "mixture"
    components: int = 1
    lambda_: float = 1e-6
    psi: float = 0.5
    kappa: float = 100.0
    gamma: float = 0.99
    batch: int = 50
    buffer: int = 10_000
    weights: int = 10
    alpha_mu: float = 1e-3
    alpha_L: float = 0.1
    sigma_p2: float = 1e-5
    sigma_min: float = 1e-4
    init: str = "sources"
    act: str = "step"
    covariance: str = "full"
    patience = 0  # without an annotation it is no field: only `PatientSettings` store it

    def __post_init__(self) -> None:
        check_psi(self.psi)
        check_between("lambda_", self.lambda_, 0, HUGE)
        check_between("gamma", self.gamma, 0, 1, below=True)
        for name in ("components", "batch", "buffer", "weights"):
            check_whole(name, getattr(self, name))
        for name in ("kappa", "alpha_mu", "alpha_L", "sigma_p2", "sigma_min"):
            check_positive(name, getattr(self, name))
        check_one_of("family", self.family, ("gaussian", "mixture"))
        other = "span" if self.family == "gaussian" else "mean"
        check_one_of("init", self.init, ("sources", other))
        check_one_of("act", self.act, ("step", "episode"))
        check_one_of("covariance", self.covariance, ("full", "diagonal"))
        if self.family == "gaussian" and self.components != 1:
            raise ValueError(
                f"components must be 1: a gaussian posterior has 1 component, got {self.components}"
            )
        if self.covariance == "diagonal" and self.init == "span":
            raise ValueError(
                "init must be 'sources', got 'span': a diagonal posterior cannot start within the "
                "span of the sources"
            )


@dataclass(frozen=True)
class PatientSettings(Settings):
    """Settings of an agent that only acts and remembers for the first ``patience`` iterations.

    Raises ValueError for a value outside its range.
    """

    patience: int = 500

    def __post_init__(self) -> None:
        super().__post_init__()
        check_whole("patience", self.patience, 0)


class VariationalTransfer:
    """Algorithm 1 for R runs in lock-step: ``act``, then ``learn`` from the transition.

    sources: (R, S, d), the S source weights of each run; the posterior and its gradients live on
    their device, observations and actions on the processor. noise, component and replay are the
    streams of posterior samples, of the acting component and of mini-batches. ``mu`` (R, C, d) are
    the posterior's means. Raises ValueError when sources are missing, not finite, not float32 or
    not of the Q-function's shape.
    """

    _clip = CLIP

    def __init__(
        self,
        q: QFunction,
        sources: Tensor,
        obs_dim: int,
        settings: Settings,
        noise: Stream,
        component: Stream,
        replay: Stream,
    ) -> None:
        check_kind("settings", settings, Settings)
        check_sources(sources, q.d)
        check_runs(len(sources), noise, component, replay)
        sources = sources.detach()
        self._q, self._settings, self._sources = q, settings, sources
        self._device = sources.device
        self._noise, self._component, self._replay = noise, component, replay
        self._prior_mean = sources.mean(1, keepdim=True)
        start, self._precision = self._start()
        self.mu, self._factors = start.mu, self._factors_from(start.L.flatten(0, 1))
        del start  # its factors were copied, and fill more memory than all that is made below
        self._adam = torch.optim.Adam([self.mu], lr=settings.alpha_mu, fused=True)
        self._buffer = ReplayBuffer(len(sources), settings.buffer, obs_dim)
        self._steps = 0
        self._sample()
        self._acting = self._thompson()

    @property
    def L(self) -> Tensor:
        """The posterior's Cholesky factors, (R, C, d, d)."""
        factors: Tensor = self._factors.L.unflatten(0, self.mu.shape[:2])
        return factors

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Greedy actions (R,) of one posterior sample; fresh (R,) marks first steps of episodes."""
        # drawn at every step, used or not: a run's stream must not depend on when its neighbours'
        # episodes end
        draw = self._thompson()
        if self._settings.act == "step":
            self._acting = draw
        else:
            self._acting = torch.where(fresh.view(-1, 1, 1).to(self._device), draw, self._acting)
        values = self._q.q(self._acting, self._q.prepare(obs.unsqueeze(1).to(self._device)))
        return values[:, 0, :, 0].argmax(-1).cpu()

    def learn(self, transition: Transition) -> None:
        """Store one transition of each run and take one gradient step on eq. 5.2."""
        s = self._settings
        self._buffer.add(transition)
        self._steps += 1
        batch = self._buffer.sample(self._replay.uniform(s.batch))
        if self._steps > s.patience:
            self._descend(Transition(*(x.to(self._device) for x in batch)))
        self._sample()

    def remembered(self, u: Tensor) -> Transition:
        """Transitions (R, B) of the replay memory, chosen by uniform numbers u (R, B)."""
        return self._buffer.sample(u)

    def _descend(self, batch: Transition) -> None:
        s = self._settings
        kl_weight = s.lambda_ / self._steps
        runs, components, d = self.mu.shape
        weights = self._samples[:, :, 1:].reshape(runs, components * s.weights, d)
        # the posterior's expectation is a mean over components and over their samples
        gradients = self._td_gradients(weights, batch)
        gradients = gradients.div_(components * s.weights).view(runs, components, s.weights, d)
        step = gradients.sum(2).add_(self._kl_gradient(), alpha=kl_weight)
        self.mu.grad = step.clamp_(-self._clip, self._clip)
        self._adam.step()
        self._factors.step(
            gradients.flatten(0, 1), self._z[:, 1:], kl_weight=kl_weight / components
        )

    def _start(self) -> tuple[Gaussian, Precision]:
        return initial_posterior(self._sources, self._settings)

    def _factors_from(self, L: Tensor) -> Factors:
        s = self._settings
        kind = _factors_of(s, self._q.d)
        return kind(L, self._precision, s.alpha_L, s.sigma_min, self._clip)

    def _td_gradients(self, weights: Tensor, batch: Transition) -> Tensor:
        s = self._settings
        return td_gradients(self._q, weights, batch, s.psi, s.gamma, s.kappa)

    def _kl_gradient(self) -> Tensor:
        if self._settings.family == "mixture":
            return pull_of_sources(self.mu, self._sources, self._settings.sigma_p2)
        return self._precision.times((self.mu - self._prior_mean).transpose(1, 2)).transpose(1, 2)

    def _sample(self) -> None:
        """Draw w = mu + L z: one to act with and ``weights`` for the gradient, per component."""
        runs, components, d = self.mu.shape
        count, ahead = self._settings.weights + 1, self._factors.ahead
        at = self._steps % ahead
        if at == 0:
            noise = self._noise.normal(ahead * components * count * d).to(self._device)
            noise = noise.view(runs, ahead, components, count, d).transpose(0, 1)
            self._noise_ahead = noise.flatten(1, 2)
            self._factors.look_ahead(self._noise_ahead)
        self._z = self._noise_ahead[at]
        self._samples = self._factors.product(at).view(runs, components, count, d)
        self._samples += self.mu.unsqueeze(2)

    def _thompson(self) -> Tensor:
        """One sample (R, 1, d) of the mixture: a component, then its first draw."""
        _, components, d = self.mu.shape
        draws = self._samples[:, :, 0]
        if components == 1:
            return draws
        index = (self._component.uniform(1) * components).long().clamp_(max=components - 1)
        index = index.to(self._device)
        return draws.gather(1, index.unsqueeze(-1).expand(-1, -1, d))


def _factors_of(settings: Settings, d: int) -> type[Factors]:
    if settings.covariance == "diagonal":
        return DiagonalFactors
    return DeferredFactors if d >= LARGE else CholeskyFactors


def td_gradients(
    q: QFunction,
    weights: Tensor,
    batch: Transition,
    psi: float,
    gamma: float,
    kappa: float,
    cotangent: Cotangent | None = None,
) -> Tensor:
    """Gradients (R, K, d) of the mean squared TD error at weights (R, K, d), eq. 5.4.

    cotangent: gives its derivatives with respect to the Q-values; ``td_cotangent`` if not named.
    """
    runs, k, _ = weights.shape
    size = 2 * batch.obs.shape[1] * q.width  # of what one weight vector passes on
    rows = min(runs, max(1, CACHED // (k * size)))
    columns = math.ceil(k / math.ceil(k * size / CACHED)) if rows == 1 else k
    if (rows, columns) == (runs, k):
        return _td_gradients(q, weights, batch, psi, gamma, kappa, cotangent)
    # some at a time: what networks pass on for all weights would not fit into the cache
    gradients = torch.empty_like(weights)
    for at in range(0, runs, rows):
        few = Transition(*(x[at : at + rows] for x in batch))
        for start in range(0, k, columns):
            part = slice(at, at + rows), slice(start, start + columns)
            gradients[part] = _td_gradients(q, weights[part], few, psi, gamma, kappa, cotangent)
    return gradients


def _td_gradients(
    q: QFunction,
    weights: Tensor,
    batch: Transition,
    psi: float,
    gamma: float,
    kappa: float,
    cotangent: Cotangent | None,
) -> Tensor:
    size = batch.obs.shape[1]
    x = q.prepare(torch.cat([batch.obs, batch.next_obs], 1))
    values, pullback = q.vjp(weights, x)
    cotangents = (cotangent or td_cotangent)(
        values[..., :size],
        values[..., size:],
        batch.action.unsqueeze(1),
        batch.reward.unsqueeze(1),
        batch.terminal.unsqueeze(1),
        psi,
        gamma,
        kappa,
    )
    return pullback(torch.cat(cotangents, -1))


def initial_posterior(
    sources: Tensor, settings: Settings, prior_jitter: float = PRIOR_JITTER
) -> tuple[Gaussian, Precision]:
    """The posterior's start, mu (R, C, d) and L (R, C, d, d), and the prior's precision.

    The minimiser of the KL is the prior itself for a Gaussian (eqs. 5.5 and 5.6), or, without
    correlations, the Gaussian of its mean and the diagonal of its precision; and C different
    sources with the prior's variance for a mixture (eq. 5.13), whose L share their memory. Raises
    ValueError unless sources are finite, float32 or float64, of shape (R, S, d), and no farther
    apart than a Gaussian prior's covariance can tell.
    """
    check_kind("sources", sources, Tensor)
    kinds = ("float32", "float64")
    check_weights("sources", sources, "run", "source", "weight", kinds=kinds)
    runs, count, d = sources.shape
    if settings.family == "gaussian":
        mu, spread = sources_mean_and_spread(sources)
        try:
            precision = low_rank_precision(spread, prior_jitter)
            if settings.covariance == "diagonal":
                factor = torch.diag_embed(precision.diagonal(d).rsqrt())
            else:
                jitter = SPAN_JITTER if settings.init == "span" else prior_jitter
                factor = covariance_factor(spread, jitter)
        except torch.linalg.LinAlgError:  # type: ignore[attr-defined]  # documented, not typed
            factor = torch.tensor(math.nan)
        if not all(extreme.isfinite() for extreme in torch.aminmax(factor)):
            apart = float((sources - mu.unsqueeze(1)).abs().amax())
            raise ValueError(
                "sources must lie closer to their mean for a gaussian posterior, whose covariance "
                f"rounding spoils, got weights that are {apart:g} away"
            )
        return Gaussian(mu.unsqueeze(1).contiguous(), factor.unsqueeze(1)), precision
    components = settings.components
    if settings.init == "sources":
        mu = sources[:, torch.arange(components) % count].clone()
    else:
        mu = sources.mean(1, keepdim=True).repeat(1, components, 1)
    eye = torch.eye(d, device=sources.device) * settings.sigma_p2**0.5
    return Gaussian(mu, eye.expand(runs, components, d, d)), Precision(1 / settings.sigma_p2)


def check_sources(sources: Tensor, d: int) -> None:
    """Raise ValueError unless sources are a float32 tensor of finite weights (R, S, d), S >= 1."""
    check_kind("sources", sources, Tensor)
    check_weights("sources", sources, "run", "source", d)
