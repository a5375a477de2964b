"""Variational posteriors over Q-function weights, by the form of their covariance."""

from __future__ import annotations

from collections.abc import Callable

from vtlib.native import kernels
from vtlib.posteriors.base import Descent, Posterior
from vtlib.posteriors.dense import Dense
from vtlib.posteriors.diagonal import Diagonal
from vtlib.posteriors.fused import MOST_SAMPLES, Fused
from vtlib.priors import Precision, Start
from vtlib.rng import Stream

__all__ = ["COVARIANCES", "Descent", "Posterior"]


def _full(
    start: Start, precision: Precision, descent: Descent, noise: Stream, n_samples: int
) -> Posterior:
    """A full covariance, by the kernel where there is one; "dense" leaves it to torch."""
    fused = kernels() is not None and start.mu.device.type == "cpu" and n_samples <= MOST_SAMPLES
    return (Fused if fused else Dense)(start, precision, descent, noise, n_samples)


Maker = Callable[[Start, Precision, Descent, Stream, int], Posterior]

#: A family of posteriors is chosen by its name here; a new one is a class and a line.
COVARIANCES: dict[str, Maker] = {"full": _full, "dense": Dense, "diagonal": Diagonal}
