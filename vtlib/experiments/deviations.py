"""Where thesis, published code and this library differ: an agent with switches, and its runs.

Each switch turns one choice of this library into another one, that of the published code or one
that the thesis leaves open. The runs have the targets, sources and random numbers of the rooms
evaluation, so that each of them has a twin there.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace

import torch
from torch import Tensor

from vtlib.envs.episodes import Tasks
from vtlib.envs.rooms import Rooms
from vtlib.experiments.control import CARTPOLE, CARTPOLE_OTHER_SOURCES
from vtlib.experiments.experiment import Experiment
from vtlib.experiments.rooms import GVT, MGVT, ROOMS_EVALUATION, THREE_ROOMS
from vtlib.factor import CholeskyFactors
from vtlib.gaussian import Gaussian, Precision
from vtlib.mellow import td_cotangent
from vtlib.qfunctions import QFunction
from vtlib.replay import Transition
from vtlib.sources import Pool
from vtlib.streams import Stream
from vtlib.transfer import (
    CLIP,
    PRIOR_JITTER,
    Factors,
    Settings,
    VariationalTransfer,
    initial_posterior,
    td_gradients,
)


@dataclass(frozen=True)
class DeviatingSettings(Settings):
    """Settings with a switch for each deviation; by default none of them is on.

    kl: the divergence of the "full" L, or of its "diagonal" alone. psi_at_end: the psi part of
    the gradient is "masked" past a terminal state, or "unmasked". responsibilities: "exact", or
    "equal" for all sources. jitter: added to the variances of the Gaussian prior. clip: elementwise
    bound on every gradient, None for none. time_limit: steps after which an episode's end counts as
    a terminal state, 0 for never. Raises ValueError for a value outside its range.
    """

    kl: str = "full"
    psi_at_end: str = "masked"
    responsibilities: str = "exact"
    jitter: float = PRIOR_JITTER
    clip: float | None = CLIP
    time_limit: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, allowed in (
            ("kl", ("full", "diagonal")),
            ("psi_at_end", ("masked", "unmasked")),
            ("responsibilities", ("exact", "equal")),
        ):
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name} must be one of {allowed}, got {getattr(self, name)!r}")
        if not (math.isfinite(self.jitter) and self.jitter > 0):
            raise ValueError(f"jitter must be finite and positive, got {self.jitter}")
        if self.clip is not None and not (math.isfinite(self.clip) and self.clip > 0):
            raise ValueError(f"clip must be None, or finite and positive, got {self.clip}")
        if not (isinstance(self.time_limit, int) and self.time_limit >= 0):
            raise ValueError(f"time_limit must be a whole number, got {self.time_limit}")
        if self.covariance == "diagonal" and self.kl == "diagonal":
            raise ValueError("a diagonal posterior has no entries off the diagonal to leave out")


class DeviatingTransfer(VariationalTransfer):
    """Algorithm 1 with the deviations that its settings switch on."""

    _settings: DeviatingSettings

    def __init__(
        self,
        q: QFunction,
        sources: Tensor,
        obs_dim: int,
        settings: DeviatingSettings,
        noise: Stream,
        component: Stream,
        replay: Stream,
    ) -> None:
        self._clip = math.inf if settings.clip is None else settings.clip
        super().__init__(q, sources, obs_dim, settings, noise, component, replay)
        self._age = torch.zeros(len(sources), dtype=torch.int64)

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Greedy actions (R,) of one posterior sample; fresh (R,) marks first steps of episodes."""
        self._age = torch.where(fresh, 1, self._age + 1)
        return super().act(obs, fresh)

    def learn(self, transition: Transition) -> None:
        """Store one transition of each run and take one gradient step on eq. 5.2."""
        limit = self._settings.time_limit
        if limit:
            over = transition.terminal | (self._age >= limit)
            transition = transition._replace(terminal=over)
        super().learn(transition)

    def _start(self) -> tuple[Gaussian, Precision]:
        return initial_posterior(self._sources, self._settings, self._settings.jitter)

    def _factors_from(self, L: Tensor) -> Factors:
        s = self._settings
        if s.kl == "full":
            return super()._factors_from(L)
        return DiagonalPullFactors(L, self._precision, s.alpha_L, s.sigma_min, self._clip)

    def _td_gradients(self, weights: Tensor, batch: Transition) -> Tensor:
        s = self._settings
        if s.psi_at_end == "masked":
            return super()._td_gradients(weights, batch)
        return td_gradients(self._q, weights, batch, s.psi, s.gamma, s.kappa, unmasked_cotangent)

    def _kl_gradient(self) -> Tensor:
        s = self._settings
        if s.family == "mixture" and s.responsibilities == "equal":
            return (self.mu - self._prior_mean) / (s.sigma_p2 * self.mu.shape[1])
        return super()._kl_gradient()


class DiagonalPullFactors(CholeskyFactors):
    """Factors L whose entries off the diagonal feel no divergence.

    Its eigenvalues are taken to be those of the squared diagonal of L: eq. 5.9 becomes
    P_ii L_ii - 1 / L_ii on the diagonal, with P the prior's precision, and zero elsewhere.
    """

    def __init__(
        self, L: Tensor, precision: Precision, alpha: float, sigma_min: float, clip: float
    ) -> None:
        super().__init__(L, precision, alpha, sigma_min, clip)
        self._pull = precision.diagonal(L.shape[-1]).to(L.device)

    def _divergence_gradient(self) -> Tensor:
        diagonal = self.L.diagonal(dim1=-2, dim2=-1)
        return self._pull * diagonal - 1 / diagonal

    def _low_rank_step(self, gradients: Tensor, noise: Tensor, kl_weight: float) -> None:
        push = self._divergence_gradient() * (-self._alpha * kl_weight)
        left = gradients.mul(-self._alpha).transpose(1, 2)
        for start, end in self._panels:
            panel = self.L[:, start:end, :end]
            panel.baddbmm_(left[:, start:end], noise[:, :, :end])
            panel[:, :, start:].tril_()
        self.L.diagonal(dim1=-2, dim2=-1).add_(push).clamp_(min=self._sigma_min)

    def _clipped_step(self, gradients: Tensor, noise: Tensor, kl_weight: float) -> None:
        gradient = torch.bmm(gradients.transpose(1, 2), noise)
        on_diagonal = gradient.diagonal(dim1=-2, dim2=-1)
        on_diagonal.add_(self._divergence_gradient(), alpha=kl_weight)
        self.L.sub_(gradient.clamp_(-self._clip, self._clip).tril_(), alpha=self._alpha)
        self.L.diagonal(dim1=-2, dim2=-1).clamp_(min=self._sigma_min)
        self._largest = self._largest_entry()


def unmasked_cotangent(
    q: Tensor,
    q_next: Tensor,
    action: Tensor,
    reward: Tensor,
    terminal: Tensor,
    psi: float,
    gamma: float = 0.99,
    kappa: float = 100.0,
) -> tuple[Tensor, Tensor]:
    """Derivatives as ``td_cotangent``, with the psi part of terminal next states left in."""
    at_state, at_next = td_cotangent(q, q_next, action, reward, terminal, psi, gamma, kappa)
    # the derivative with respect to Q(s, a), the only entry, is minus the scaled error
    flow = at_state.sum(-2, keepdim=True) * (-psi * gamma) * terminal.unsqueeze(-2)
    return at_state, at_next + flow * torch.softmax(kappa * q_next, -2)


@dataclass(frozen=True)
class CornerPool(Pool):
    """Rooms whose sources start where the targets do; tasks and random numbers of its ``twin``."""

    twin: str = ""

    @property
    def stream(self) -> str:
        """What seeds the sources."""
        return self.twin or self.name

    def for_learning(self, tasks: Tasks) -> Tasks:
        """The tasks as the sources learn them: as they are."""
        return tasks


def _changed(base: Settings, **changes: object) -> DeviatingSettings:
    return DeviatingSettings(**{**asdict(base), **changes})


# Half of the rooms evaluation: the thesis compares GVT and 1-MGVT at 5,000 iterations.
DEVIATION_ITERATIONS = 5_000
ROOMS_DEVIATIONS = replace(
    ROOMS_EVALUATION,
    name="rooms-deviations",
    algorithms={
        "GVT-diagonal-KL": _changed(GVT, kl="diagonal"),
        "1-MGVT-diagonal-KL": _changed(MGVT, kl="diagonal"),
        "GVT-unmasked": _changed(GVT, psi_at_end="unmasked"),
        "1-MGVT-unmasked": _changed(MGVT, psi_at_end="unmasked"),
        "1-MGVT-mean-equal": _changed(MGVT, init="mean", responsibilities="equal"),
        "GVT-jitter-1e-06": _changed(GVT, jitter=1e-6),
        "GVT-jitter-1e-02": _changed(GVT, jitter=1e-2),
        "GVT-no-clip": _changed(GVT, clip=None),
        "1-MGVT-no-clip": _changed(MGVT, clip=None),
        "GVT-sigma-min": replace(GVT, sigma_min=1e-2),
        "1-MGVT-sigma-min": replace(MGVT, sigma_min=1e-2),
        "GVT-by-episode": replace(GVT, act="episode"),
        "1-MGVT-by-episode": replace(MGVT, act="episode"),
        "1-MGVT-time-limit": _changed(MGVT, time_limit=Rooms.horizon),
    },
    iterations=DEVIATION_ITERATIONS,
)

CORNER_SOURCES = CornerPool(
    "rooms-3-corner-sources",
    THREE_ROOMS.family,
    iterations=THREE_ROOMS.iterations,
    limit=THREE_ROOMS.iterations,
    twin=THREE_ROOMS.name,
)
ROOMS_CORNER = replace(
    ROOMS_DEVIATIONS,
    name="rooms-corner-sources",
    pool=CORNER_SOURCES,
    algorithms={"GVT": GVT, "1-MGVT": MGVT},
)

# An effect counts from this share of the planned optimum on, if its 95% interval excludes zero.
COUNTS = 0.05
LOWER, NONE, HIGHER, OPEN = "lower", "no effect", "higher", "undecided"


@dataclass(frozen=True)
class Comparison:
    """One algorithm as it is here, and with another choice: results as (experiment, label).

    expected: what the other choice was expected to do to the mean return over the run, written
    down before it was computed; empty where the runs had been seen before. note tells several
    other choices of one deviation apart.
    """

    algorithm: str
    other: tuple[str, str]
    here: tuple[str, str]
    expected: str = ""
    note: str = ""


@dataclass(frozen=True)
class Deviation:
    """One choice: what the thesis says, the published code does, this library does, and its runs.

    ``[page#target|words]`` in a text is a link. ``other`` is the choice that is compared with
    this library's.
    """

    what: str
    thesis: str
    published: str
    here: str
    other: str
    comparisons: tuple[Comparison, ...]


def _evaluated(
    algorithm: str, other: str, here: str = "", expected: str = "", note: str = ""
) -> Comparison:
    """Against the runs of the rooms evaluation."""
    owner = ROOMS_DEVIATIONS if other in ROOMS_DEVIATIONS.algorithms else ROOMS_EVALUATION
    twin = ROOMS_EVALUATION.name, here or algorithm
    return Comparison(algorithm, (owner.name, other), twin, expected, note)


def _otherwise(experiment: Experiment, here: Experiment, expected: str) -> tuple[Comparison, ...]:
    """GVT and 1-MGVT with other sources."""
    return tuple(
        Comparison(label, (experiment.name, label), (here.name, label), expected)
        for label in ("GVT", "1-MGVT")
    )


def _eq(number: str) -> str:
    page = "method.html" if number.startswith("5") else "background.html"
    return f"[{page}#equation-eq-{number.replace('.', '-')}|({number})]"


ALGORITHM_1 = "[method.html#algorithm-1|Algorithm 1]"
SILENT = "silent"

PUBLISHED = (
    Deviation(
        "Start of a mixture",
        f"{ALGORITHM_1}, line 2: the minimiser of the divergence; that is C different sources",
        "the mean of the sources, for all responsibilities come out equal",
        "C different sources",
        "the mean",
        (
            _evaluated("1-MGVT", "1-MGVT-mean"),
            _evaluated("3-MGVT", "3-MGVT-mean"),
        ),
    ),
    Deviation(
        "Responsibilities while learning",
        f"{_eq('5.14')} and {_eq('5.15')}, before each gradient",
        "the same, with 10⁻¹⁰ added to exponentials that have underflowed: all equal",
        "the same, in logarithms",
        "equal, from the mean on (against exact ones from the mean on)",
        (_evaluated("1-MGVT", "1-MGVT-mean-equal", "1-MGVT-mean", NONE),),
    ),
    Deviation(
        "Start of a Gaussian",
        f"{ALGORITHM_1}, line 2: the minimiser of the divergence; that is the prior",
        "the span of the sources: covariance with n − 1, variance 10⁻⁸ in any other direction; "
        "the divergence's gradient is clipped to ±100",
        "the prior",
        "the span, without that clip: not the published variant",
        (_evaluated("GVT", "GVT-span"),),
    ),
    Deviation(
        "Divergence of L",
        f"{_eq('5.7')} and {_eq('5.9')}: of all entries",
        "GVT in the rooms: of all entries; MGVT, and GVT in the mazes: the squared diagonal of L "
        "stands for its eigenvalues, other entries feel no divergence",
        "of all entries",
        "of the diagonal (for GVT here no choice of the published code)",
        (
            _evaluated("GVT", "GVT-diagonal-KL", expected=NONE),
            _evaluated("1-MGVT", "1-MGVT-diagonal-KL", expected=NONE),
        ),
    ),
)

LEFT_OPEN = (
    Deviation(
        "Terminal states in the ψ part",
        f"{_eq('5.4')} knows no terminal states",
        "the next value is left out of the target and of the ψ part of the gradient",
        "left out of both",
        "left out of the target alone",
        (
            _evaluated("GVT", "GVT-unmasked", expected=NONE),
            _evaluated("1-MGVT", "1-MGVT-unmasked", expected=NONE),
        ),
    ),
    Deviation(
        "Where sources of the rooms start",
        "sources are optimal; how they start is not said",
        "anywhere in the square",
        "anywhere in the square, and until solved",
        "in the corner, for 20,000 iterations",
        _otherwise(ROOMS_CORNER, ROOMS_EVALUATION, LOWER),
    ),
    Deviation(
        "First weights of networks",
        SILENT,
        "one draw for all sources of a pool",
        "one draw for all",
        "a draw of each source's own (cartpole)",
        _otherwise(CARTPOLE_OTHER_SOURCES["mellow-separate"], CARTPOLE, ""),
    ),
    Deviation(
        "Who solves the cartpoles",
        "mellow TD (6.2.1); parameters of DDQN (A.2.1)",
        "not known",
        "mellow TD",
        "DDQN (cartpole)",
        _otherwise(CARTPOLE_OTHER_SOURCES["ddqn-common"], CARTPOLE, ""),
    ),
    Deviation(
        "Regularisation of the prior",
        f"{_eq('5.6')} has no inverse, and nothing is said of it",
        "10⁻⁴ added to each variance",
        "10⁻⁴",
        "10⁻⁶ and 10⁻²",
        (
            _evaluated("GVT", "GVT-jitter-1e-06", expected=LOWER, note="10⁻⁶"),
            _evaluated("GVT", "GVT-jitter-1e-02", expected=LOWER, note="10⁻²"),
        ),
    ),
    Deviation(
        "Clipping of gradients",
        SILENT,
        "each entry to ±1000; before that GVT's divergence with respect to L to ±100, unweighted",
        "each entry to ±1000",
        "none",
        (
            _evaluated("GVT", "GVT-no-clip", expected=NONE),
            _evaluated("1-MGVT", "1-MGVT-no-clip", expected=NONE),
        ),
    ),
    Deviation(
        "Least variance",
        "10⁻⁴ bounds the eigenvalues of L, under the name of a variance (A.1)",
        "10⁻⁴ bounds the diagonal of L, a standard deviation",
        "10⁻⁴ bounds the diagonal of L",
        "10⁻² bounds it: the variance is 10⁻⁴",
        (
            _evaluated("GVT", "GVT-sigma-min", expected=NONE),
            _evaluated("1-MGVT", "1-MGVT-sigma-min", expected=HIGHER),
        ),
    ),
    Deviation(
        "When weights are drawn",
        f"{ALGORITHM_1}, line 7: at every step",
        "at every step",
        "at every step",
        "once an episode",
        (
            _evaluated("GVT", "GVT-by-episode", expected=HIGHER),
            _evaluated("1-MGVT", "1-MGVT-by-episode", expected=NONE),
        ),
    ),
    Deviation(
        "The end of an episode's time",
        SILENT,
        "no terminal state: the next value counts",
        "no terminal state",
        "a terminal state",
        (_evaluated("1-MGVT", "1-MGVT-time-limit", expected=NONE),),
    ),
)

GROUPS = {
    "Where the published code does otherwise": PUBLISHED,
    "What the thesis leaves open": LEFT_OPEN,
}
DEVIATIONS = PUBLISHED + LEFT_OPEN
