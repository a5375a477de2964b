"""Variational transfer (Algorithm 1), for many runs in lock-step.

A single Gaussian with a Gaussian prior is GVT (section 5.2.1), a mixture of C equally weighted
Gaussians with one prior component per source is c-MGVT (section 5.2.2). ``vtlib.algorithm1`` is the
same method line by line, for one run.
"""

from __future__ import annotations

from typing import Any, ClassVar

import torch
from attrs import field, frozen
from torch import Tensor

from vtlib.checks import HUGE, TINY, between, check_weights, one_of, positive, whole
from vtlib.posteriors import COVARIANCES, Descent
from vtlib.priors import PRIOR_JITTER, GaussianPrior, MixturePrior
from vtlib.qfunctions import QFunction, greedy
from vtlib.replay import ReplayBuffer, Transition
from vtlib.rng import Rng
from vtlib.td import LEAST_KAPPA, td_gradients


@frozen
class Settings:
    """Parameters of variational transfer, as in appendix A; ValueError for one out of range."""

    transfers: ClassVar[bool] = True

    #: Form of prior and posterior, "gaussian" (GVT) or "mixture" (MGVT).
    family: str = field(default="mixture", validator=one_of(("gaussian", "mixture")))
    #: How many Gaussians a mixture has, C.
    components: int = field(default=1, validator=whole())
    #: Weight of the KL (eq. 5.2).
    lambda_: float = field(default=1e-6, validator=between(0, HUGE))
    #: Share of the full gradient (eq. 5.4).
    psi: float = field(default=0.5, validator=between(0, 1))
    #: Sharpness of mellowmax.
    kappa: float = field(default=100.0, validator=between(LEAST_KAPPA, HUGE))
    #: Discount.
    gamma: float = field(default=0.99, validator=between(0, 1, below=True))
    #: Transitions per gradient, drawn from those remembered.
    minibatch: int = field(default=50, validator=whole())
    #: How many of the last transitions are remembered.
    buffer: int = field(default=10_000, validator=whole())
    #: Posterior samples per gradient and component.
    n_samples: int = field(default=10, validator=whole())
    #: Step size of the means (Adam).
    alpha_mu: float = field(default=1e-3, validator=positive())
    #: Step size of L (SGD).
    alpha_L: float = field(default=0.1, validator=positive())
    #: Variance of the components of a mixture prior.
    sigma_p2: float = field(default=1e-5, validator=positive())
    #: Least value on the diagonal of L.
    sigma_min: float = field(default=1e-4, validator=positive())
    #: Where the posterior starts. "sources" minimises the KL, at the prior or at C of the sources.
    #: "mean" starts all components of a mixture at the sources' mean, "span" a Gaussian within the
    #: sources' span, without variance but theirs.
    init: str = field(default="sources", validator=one_of(("sources", "mean", "span")))
    #: Whether weights to act with are drawn at every "step" or once an "episode".
    act: str = field(default="step", validator=one_of(("step", "episode")))
    #: Form of the covariance, a name in ``vtlib.posteriors.COVARIANCES``.
    covariance: str = field(default="full", validator=one_of(COVARIANCES))
    #: How many first iterations only act and remember.
    patience: int = field(default=0, validator=whole(0))
    #: What is added to the variances of the Gaussian prior.
    jitter: float = field(default=PRIOR_JITTER, validator=positive())
    #: The covariance of the Gaussian prior is a sum over S sources divided by S - ddof.
    ddof: int = field(default=0, validator=whole(0, 1))
    #: Bound on the entries of a gradient, None for none.
    clip: float | None = field(default=1000.0)
    #: The same for the gradient of the KL by L, before it is weighted.
    kl_clip: float | None = field(default=None)
    #: Whether the KL is that of the "full" L, or of its "diagonal" alone.
    kl: str = field(default="full", validator=one_of(("full", "diagonal")))
    #: Responsibilities of the sources, the "exact" ones or "equal" for all.
    responsibilities: str = field(default="exact", validator=one_of(("exact", "equal")))

    @clip.validator
    @kl_clip.validator
    def _check_clip(self, attribute: Any, value: object) -> None:
        if value is not None:
            between(TINY, HUGE)(self, attribute, value)

    def __attrs_post_init__(self) -> None:
        gaussian = self.family == "gaussian"
        refused = "mean" if gaussian else "span"
        if self.init == refused:
            raise ValueError(f"init must not be {refused!r} for a {self.family} posterior")
        if gaussian and self.components != 1:
            rule = "components must be 1: a gaussian posterior has 1 component"
            raise ValueError(f"{rule}, got {self.components}")
        if self.covariance == "diagonal" and self.init == "span":
            rule = "init must be 'sources', got 'span'"
            raise ValueError(f"{rule}: a diagonal posterior cannot start within the sources' span")

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> VariationalTransfer:
        """An agent that transfers from sources (R, S, d)."""
        return VariationalTransfer(q, sources, obs_dim, self, rng)

    def prior(self, sources: Tensor) -> GaussianPrior | MixturePrior:
        """The prior learned from sources (R, S, d)."""
        if self.family == "gaussian":
            return GaussianPrior(sources, self.jitter, self.ddof)
        return MixturePrior(sources, self.sigma_p2, self.responsibilities)


class VariationalTransfer:
    """Algorithm 1 for R runs in lock-step: ``act``, then ``learn`` from the transition.

    sources: (R, S, d); the posterior and its gradients live on their device, observations and
    actions on the processor. rng gives the streams "posterior" (samples), "component" (which one
    acts) and "replay" (minibatches). Raises ValueError when sources are missing, not finite, not
    float32 or not of the Q-function's shape.
    """

    def __init__(
        self, q: QFunction, sources: Tensor, obs_dim: int, settings: Settings, rng: Rng
    ) -> None:
        check_weights("sources", sources, "run", "source", q.d)
        s, sources = settings, sources.detach()
        self._q, self._settings, self._device = q, settings, sources.device
        self._component, self._replay = rng.stream("component"), rng.stream("replay")
        # Algorithm 1, lines 1 and 2: the prior, and the posterior that is closest to it
        self._prior = s.prior(sources)
        start = self._prior.start(s.components, s.init)
        self._posterior = COVARIANCES[s.covariance](
            start,
            self._prior.precision,
            Descent(s.alpha_L, s.sigma_min, s.clip, s.kl, s.kl_clip),
            rng.stream("posterior"),
            s.n_samples + 1,
        )
        self._adam = torch.optim.Adam([self._posterior.mu], lr=s.alpha_mu, fused=True)
        self._buffer = ReplayBuffer(len(sources), s.buffer, obs_dim)
        self._steps = 0
        # one weight vector to act with, and n_samples for the gradient, of each component
        self._samples = self._posterior.sample()
        self._acting = self._thompson()

    @property
    def mu(self) -> Tensor:
        """The posterior's means (R, C, d)."""
        return self._posterior.mu

    @property
    def scale_tril(self) -> Tensor:
        """The posterior's Cholesky factors (R, C, d, d)."""
        return self._posterior.scale_tril

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Greedy actions (R,) of one posterior sample; fresh (R,) marks first steps of episodes."""
        # a sample is drawn at every step, used or not: a run's stream must not depend on when its
        # neighbours' episodes end
        draw = self._thompson()
        if self._settings.act == "step":
            self._acting = draw
        else:
            self._acting = torch.where(fresh.view(-1, 1, 1).to(self._device), draw, self._acting)
        return greedy(self._q, self._acting, obs.to(self._device)).cpu()

    def learn(self, transition: Transition) -> None:
        """Store one transition of each run and take one gradient step on eq. 5.2."""
        self._buffer.add(transition)
        self._steps += 1
        self.update()

    def remembered(self, u: Tensor) -> Transition:
        """Transitions (R, B) of the replay memory, chosen by uniform numbers u (R, B)."""
        return self._buffer.sample(u)

    def update(self) -> None:
        """One gradient step on a minibatch, and the samples of the next."""
        batch = self._buffer.sample(self._replay.uniform(self._settings.minibatch))
        if self._steps > self._settings.patience:
            self._descend(Transition(*(x.to(self._device) for x in batch)))
        self._samples = self._posterior.sample()

    def _gradients(self, w: Tensor, batch: Transition) -> Tensor:
        """Gradients (R, K, d) of the TD error at samples w (R, K, d), eq. 5.4."""
        s = self._settings
        return td_gradients(self._q, w, batch, s.psi, s.gamma, s.kappa)

    def _descend(self, batch: Transition) -> None:
        """One step on E_q[TD error^2] + (lambda / N) KL, eqs. 5.2, 5.8 and 5.9."""
        s, mu = self._settings, self._posterior.mu
        kl_weight = s.lambda_ / self._steps
        runs, components, d = mu.shape
        w = self._samples[:, :, 1:].reshape(runs, components * s.n_samples, d)
        # the posterior's expectation is a mean over components and over their samples
        gradients = self._gradients(w, batch).div_(components * s.n_samples)
        gradients = gradients.view(runs, components, s.n_samples, d)
        step = gradients.sum(2).add_(self._prior.pull(mu), alpha=kl_weight)
        mu.grad = step if s.clip is None else step.clamp_(-s.clip, s.clip)
        self._adam.step()
        # each component has its share 1 / C of the divergence
        self._posterior.step(gradients, kl_weight / components)

    def _thompson(self) -> Tensor:
        """One sample (R, 1, d) of the mixture: a component, then its first draw."""
        _, components, d = self._posterior.mu.shape
        draws = self._samples[:, :, 0]
        if components == 1:
            return draws
        index = (self._component.uniform(1) * components).long().clamp_(max=components - 1)
        index = index.to(self._device)
        return draws.gather(1, index.unsqueeze(-1).expand(-1, -1, d))
