"""What the neighbours share: settings of the TD error, a replay buffer, and greedy acting."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from attrs import field, frozen
from torch import Tensor

from vtlib.checks import HUGE, between, check_weights, whole
from vtlib.qfunctions import QFunction, greedy
from vtlib.replay import ReplayBuffer, Transition
from vtlib.rng import Rng
from vtlib.td import LEAST_KAPPA, td_gradients


@frozen(kw_only=True)
class TDSettings:
    """Parameters of the squared TD error (eq. 5.4) and its minibatches.

    Raises ValueError for a value outside its range.
    """

    transfers: ClassVar[bool] = True

    psi: float = field(default=0.5, validator=between(0, 1))
    kappa: float = field(default=100.0, validator=between(LEAST_KAPPA, HUGE))
    gamma: float = field(default=0.99, validator=between(0, 1, below=True))
    minibatch: int = field(default=50, validator=whole())
    buffer: int = field(default=50_000, validator=whole())


class Learner(ABC):
    """An agent of R runs in lock-step that acts greedily by some weights and learns from a buffer.

    sources: (R, S, d). rng gives the stream "replay" (minibatches), and others to subclasses.
    Raises ValueError when sources are missing, not finite, not float32 or not of the Q-function's
    shape.
    """

    mu: Tensor  # weights (R, C, d) of the greedy policy

    def __init__(self, q: QFunction, sources: Tensor, obs_dim: int, settings: Any, rng: Rng):
        check_weights("sources", sources, "run", "source", q.d)
        self._q, self._replay = q, rng.stream("replay")
        self._buffer = ReplayBuffer(len(sources), settings.buffer, obs_dim)
        self._td, self._steps = settings, 0

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Greedy actions (R,); fresh (R,) marks first steps of episodes."""
        return greedy(self._q, self._acting(fresh), obs)

    def learn(self, transition: Transition) -> None:
        """Store one transition of each run and learn from what is remembered."""
        self._buffer.add(transition)
        self._steps += 1
        self.update()

    def update(self) -> None:
        """One step of learning from a minibatch of what is remembered."""
        self._descend(self._buffer.sample(self._replay.uniform(self._td.minibatch)))

    def _gradients(self, w: Tensor, batch: Transition) -> Tensor:
        """Gradients (R, K, d) of the mean squared TD error at weights w (R, K, d)."""
        s = self._td
        return td_gradients(self._q, w, batch, s.psi, s.gamma, s.kappa)

    @abstractmethod
    def _acting(self, fresh: Tensor) -> Tensor:
        """Weights (R, 1, d) to act with."""

    @abstractmethod
    def _descend(self, batch: Transition) -> None:
        """One step of learning from a minibatch (R, B)."""
