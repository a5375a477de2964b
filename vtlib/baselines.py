"""Learning without transfer: mellow TD with epsilon-greedy exploration."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from vtlib.mellow import check_psi
from vtlib.qfunctions import QFunction
from vtlib.replay import ReplayBuffer, Transition
from vtlib.streams import Stream
from vtlib.transfer import td_gradients


@dataclass(frozen=True)
class MellowTDSettings:
    """Parameters of mellow TD (section 5.1.4); epsilon falls linearly from 1 to epsilon_end.

    epsilon_steps: iterations over which epsilon falls. alpha: Adam's step size. Raises ValueError
    for a value outside its range.
    """

    epsilon_steps: int
    epsilon_end: float = 0.02
    psi: float = 0.5
    kappa: float = 100.0
    gamma: float = 0.99
    batch: int = 50
    buffer: int = 50_000
    alpha: float = 1e-3

    def __post_init__(self) -> None:
        check_psi(self.psi)
        if not 0 <= self.epsilon_end <= 1:
            raise ValueError(f"epsilon_end must lie in [0, 1], got {self.epsilon_end}")
        if not 0 <= self.gamma < 1:
            raise ValueError(f"gamma must lie in [0, 1), got {self.gamma}")
        for name in ("epsilon_steps", "batch", "buffer"):
            value = getattr(self, name)
            if not (isinstance(value, int) and value >= 1):
                raise ValueError(f"{name} must be a whole number of at least 1, got {value}")
        for name in ("kappa", "alpha"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be finite and positive, got {value}")


class MellowTD:
    """Direct minimisation of the squared mellow TD error (eq. 5.4) for R runs in lock-step.

    w: (R, d) initial weights, copied. exploration and replay are the streams of epsilon-greedy
    actions and of mini-batches. ``mu`` (R, 1, d) are the current weights.
    """

    def __init__(
        self,
        q: QFunction,
        w: Tensor,
        obs_dim: int,
        settings: MellowTDSettings,
        exploration: Stream,
        replay: Stream,
    ) -> None:
        if w.ndim != 2 or w.shape[1] != q.d or not torch.isfinite(w).all():
            raise ValueError(
                f"weights must be finite, of shape (runs, {q.d}), got {tuple(w.shape)}"
            )
        self._q, self._settings = q, settings
        self._exploration, self._replay = exploration, replay
        self.mu = w.unsqueeze(1).clone()
        self._adam = torch.optim.Adam([self.mu], lr=settings.alpha, fused=True)
        self._buffer = ReplayBuffer(len(w), settings.buffer, obs_dim)
        self._steps = 0

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Epsilon-greedy actions (R,)."""
        s = self._settings
        progress = min(1.0, self._steps / s.epsilon_steps)
        epsilon = 1 + progress * (s.epsilon_end - 1)
        greedy = self._q.q(self.mu, self._q.prepare(obs.unsqueeze(1)))[:, 0, :, 0].argmax(-1)
        explore, choice = self._exploration.uniform(2).unbind(-1)
        random = (choice * self._q.n_actions).long().clamp_(max=self._q.n_actions - 1)
        return torch.where(explore < epsilon, random, greedy)

    def learn(self, transition: Transition) -> None:
        """Store one transition of each run and take one gradient step."""
        s = self._settings
        self._buffer.add(transition)
        self._steps += 1
        batch = self._buffer.sample(self._replay.uniform(s.batch))
        self.mu.grad = td_gradients(self._q, self.mu, batch, s.psi, s.gamma, s.kappa)
        self._adam.step()
