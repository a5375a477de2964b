"""Random streams: one generator per run and role, so that runs never disturb each other."""

import hashlib
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

BLOCK = 1 << 20  # floats that all runs draw ahead, so many that Python's cost is hidden


def generator(experiment: str, run: int, role: str) -> np.random.Generator:
    """The generator of one run and role, the same on every machine and in every batch of runs."""
    digest = hashlib.sha256(f"{experiment}/{run}/{role}".encode()).digest()
    return np.random.Generator(np.random.SFC64(int.from_bytes(digest[:16], "big")))


class Stream:
    """Random numbers of one role for a batch of runs, one independent generator per run.

    All draws of a stream must be of the same kind and count ``n``. Its values depend neither on how
    many are drawn ahead nor on the runs beside it.
    """

    def __init__(self, experiment: str, runs: Sequence[int], role: str) -> None:
        self._generators = [generator(experiment, run, role) for run in runs]
        self._block = torch.empty(len(runs), 0)
        self._next = 0

    def normal(self, n: int) -> Tensor:
        """Standard normal numbers, float32 of shape (R, n)."""
        return self._draw("normal", n)

    def uniform(self, n: int) -> Tensor:
        """Numbers uniform on [0, 1), float32 of shape (R, n)."""
        return self._draw("uniform", n)

    def keep(self, rows: Sequence[int]) -> None:
        """Go on with some of the runs, by their places in the batch, in that order."""
        self._generators = [self._generators[row] for row in rows]
        self._block = self._block[rows]

    def _draw(self, kind: str, n: int) -> Tensor:
        if self._next == self._block.shape[1]:
            ahead = max(1, min(256, BLOCK // max(1, n * len(self._generators))))
            block = np.empty((len(self._generators), ahead, n), np.float32)
            for rng, numbers in zip(self._generators, block, strict=True):
                if kind == "normal":
                    rng.standard_normal(dtype=np.float32, out=numbers)
                else:
                    rng.random(dtype=np.float32, out=numbers)
            self._block, self._next = torch.from_numpy(block), 0
        self._next += 1
        return self._block[:, self._next - 1]


class Rng:
    """The random numbers of a batch of runs: a stream for each role that asks for one."""

    def __init__(self, experiment: str, runs: Sequence[int]) -> None:
        self._experiment, self._runs = experiment, list(runs)

    def stream(self, role: str) -> Stream:
        """The stream of a role, from its beginning."""
        return Stream(self._experiment, self._runs, role)
