"""Exact posteriors over value functions that close in on a task as transitions arrive.

A walker crosses a corridor at speed 1, four times slower in mud, and is paid at its end. There is
one action, so that TD errors are linear and eq. 5.1 has a closed form.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from vtlib.priors import Gaussian

LENGTH, MUD, SLOW = 10.0, 2.0, 0.25  # the corridor, the stretch of mud, the speed in it
GAMMA = 0.9
TARGET_MUD = 5.2  # the middle of the mud in the target

Triple = tuple[Tensor, Tensor, Tensor]


def clock(mud: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions (4,) at which the speed changes, and the times (4,) from there to the end."""
    at = np.array([0, mud - MUD / 2, mud + MUD / 2, LENGTH])
    durations = np.diff(at) / [1, SLOW, 1]
    return at, durations.sum() - np.append(0, durations.cumsum())


def features(s: Tensor) -> Tensor:
    """Normalised radial bases (..., 21) at positions s (...)."""
    centres = torch.linspace(0, LENGTH, 21, dtype=s.dtype)
    return torch.softmax(-0.5 * ((s.unsqueeze(-1) - centres) / 0.35) ** 2, -1)


def value(s: Tensor, mud: float) -> Tensor:
    """True values (...) at s (...): gamma to the power of the time that remains."""
    return torch.from_numpy(GAMMA ** np.interp(s, *clock(mud)))


def walk(count: int, rng: np.random.Generator) -> Triple:
    """Transitions through the target: positions (N,), rows x (N, d) and rewards r (N,).

    Their TD errors (eq. 2.15) are r - x w. Each episode begins somewhere in the first metre.
    """
    at, times = clock(TARGET_MUD)
    left = np.zeros(0)
    while len(left) < count:
        left = np.append(left, np.arange(np.interp(rng.uniform(0, 1), at, times), 0, -1))
    left = left[:count]
    here, onward = (torch.from_numpy(np.interp(-t, -times, at)) for t in (left, left - 1))
    going = torch.from_numpy(left > 1)
    rows = features(here) - GAMMA * features(onward) * going.unsqueeze(-1)
    return here, rows, value(here, TARGET_MUD) * ~going


def gibbs(prior: Gaussian, x: Tensor, r: Tensor, lambda_: float) -> Triple:
    """The posterior of eq. 5.1 with Lambda = N / lambda, for N TD errors r - x w, (N,) and (N, d).

    prior: equally weighted components, means (J, d) and one factor (d, d). The TD errors act like
    Gaussian noise of variance lambda / 2. Returns the components' weights (J,), means (J, d) and
    common covariance (d, d).
    """
    covariance = prior.scale_tril @ prior.scale_tril.T
    expected = x @ covariance @ x.T + lambda_ / 2 * torch.eye(len(r), dtype=x.dtype)
    surprise = r - prior.mu @ x.T  # (J, N)
    gain = torch.linalg.solve(expected, x @ covariance)  # (N, d)
    evidence = -0.5 * (surprise * torch.linalg.solve(expected, surprise.T).T).sum(-1)
    return evidence.softmax(0), prior.mu + surprise @ gain, covariance - covariance @ x.T @ gain
