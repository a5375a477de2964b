"""Replay buffers of many runs that advance in lock-step."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor


class Transition(NamedTuple):
    """One or many transitions; leading axes (R,) for one step, (R, B) for a minibatch.

    obs, next_obs: (..., obs_dim); action int64; reward float; terminated bool. A transition cut by
    the horizon is truncated, not terminated: its next state still has a value.
    """

    obs: Tensor
    action: Tensor
    reward: Tensor
    next_obs: Tensor
    terminated: Tensor


class ReplayBuffer:
    """Ring buffer of the last ``capacity`` transitions of each run, sampled with replacement."""

    def __init__(self, runs: int, capacity: int, obs_dim: int) -> None:
        self._capacity = capacity
        self._obs_dim = obs_dim
        # a row holds a whole transition, which is so written and gathered in one operation each
        self._rows = torch.zeros(runs, min(capacity, 1024), 2 * obs_dim + 3)
        self._added = 0

    def __len__(self) -> int:
        return min(self._added, self._capacity)

    def add(self, transition: Transition) -> None:
        """Store one transition of each run, leading axis (R,), over the oldest when full."""
        at = self._added % self._capacity
        if at == self._rows.shape[1]:
            room = min(self._capacity, 2 * at) - at
            self._rows = torch.cat([self._rows, torch.zeros_like(self._rows[:, :room])], 1)
        obs, action, reward, next_obs, terminated = transition
        tail = torch.stack([action.float(), reward, terminated.float()], -1)
        self._rows[:, at] = torch.cat([obs, next_obs, tail], -1)
        self._added += 1

    def rows(self) -> Tensor:
        """A copy (R, n, 2 obs_dim + 3) of all that is stored, the oldest first."""
        at = self._added % self._capacity if self._added > self._capacity else 0
        return self._rows[:, : len(self)].roll(-at, 1).clone()

    def fill(self, rows: Tensor) -> None:
        """Hold what another buffer held: its ``rows``, at most as many as the capacity."""
        if rows.shape[1]:
            self._rows, self._added = rows.clone(), rows.shape[1]

    def keep(self, rows: Sequence[int]) -> None:
        """Go on with some of the runs, by their places in the batch, in that order."""
        self._rows = self._rows[rows]

    def sample(self, uniforms: Tensor) -> Transition:
        """A minibatch (R, B) chosen by uniforms (R, B) on [0, 1)."""
        size = len(self)
        index = (uniforms * size).long().clamp_(max=size - 1)
        rows = self._rows.gather(1, index.unsqueeze(-1).expand(-1, -1, self._rows.shape[2]))
        o = self._obs_dim
        action, reward, terminal = rows[..., 2 * o :].unbind(-1)
        return Transition(rows[..., :o], action.long(), reward, rows[..., o : 2 * o], terminal > 0)
