"""Variational posteriors over Q-function weights, by the form of their covariance."""

from collections.abc import Callable

from vtlib.native import LOGGER, kernels
from vtlib.posteriors.base import Descent, Posterior
from vtlib.posteriors.dense import Dense
from vtlib.posteriors.diagonal import Diagonal, Fixed
from vtlib.posteriors.native import MOST_SAMPLES, Blocked, Fused
from vtlib.priors import Precision, Start
from vtlib.rng import Stream

__all__ = ["COVARIANCES", "Descent", "Posterior"]

LARGE = 2000  # from so many weights on a covariance is diagonal unless "dense" is asked for
CALM = 1e-4  # the largest step on a diagonal that has destroyed no network's weights
MANY = 400  # from so many weights on blocks are faster: the cache no longer holds L


def _full(
    start: Start, precision: Precision, descent: Descent, noise: Stream, n_samples: int
) -> Posterior:
    """A full covariance, by a kernel where there is one; of a large network a diagonal one."""
    d = start.mu.shape[2]
    if d >= LARGE:
        LOGGER.warning("covariances of %d weights are diagonal; 'dense' keeps them full", d)
        calm = descent._replace(alpha=min(descent.alpha, CALM))
        return Diagonal(start, precision, calm, noise, n_samples)
    kind: type[Dense | Fused | Blocked] = Dense
    if kernels() is not None and start.mu.device.type == "cpu" and n_samples <= MOST_SAMPLES:
        blocks = precision.W is None or descent.kl == "diagonal"
        kind = Blocked if blocks and d >= MANY else Fused
    return kind(start, precision, descent, noise, n_samples)


#: A family of posteriors is chosen by its name here; a new one is a class and a line.
COVARIANCES: dict[str, Callable[[Start, Precision, Descent, Stream, int], Posterior]] = {
    "full": _full,
    "dense": Dense,
    "diagonal": Diagonal,
    "fixed": Fixed,
}
