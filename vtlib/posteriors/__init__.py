"""Variational posteriors over Q-function weights, by the form of their covariance."""

from collections.abc import Callable

from vtlib.native import LOGGER, kernels
from vtlib.posteriors.base import Descent, Posterior
from vtlib.posteriors.blocked import Blocked
from vtlib.posteriors.dense import Dense
from vtlib.posteriors.diagonal import Diagonal
from vtlib.posteriors.fixed import Fixed
from vtlib.posteriors.fused import Fused
from vtlib.posteriors.native import MOST_SAMPLES
from vtlib.priors import Precision, Start
from vtlib.rng import Stream

__all__ = ["COVARIANCES", "Descent", "Diagonal", "Posterior"]

LARGE = 2000  # from so many weights on a covariance is diagonal unless "dense" is asked for
CALM = 1e-4  # the largest step on a diagonal that has destroyed no network's weights
GIGABYTE = 1e9
MANY = 400  # from so many weights on blocks are faster: the cache no longer holds L


def _full(
    start: Start, precision: Precision, descent: Descent, noise: Stream, n_samples: int
) -> Posterior:
    """A full covariance, by a kernel where there is one; "dense" leaves it to torch.

    Of a large network it is diagonal, with one line in the log that says so.
    """
    runs, components, d = start.mu.shape
    size = 4 * runs * components * d**2 / GIGABYTE
    if d >= LARGE:
        shape = f"{d:,} weights would take {size:,.1f} GB as full covariances"
        LOGGER.warning("%s: they are diagonal (covariance='dense' keeps them full)", shape)
        calm = descent._replace(alpha=min(descent.alpha, CALM))
        return Diagonal(start, precision, calm, noise, n_samples)
    if size > 1:
        LOGGER.warning("the full covariances of %s weights take %.1f GB", f"{d:,}", size)
    kind: type[Dense | Fused | Blocked] = Dense
    if kernels() is not None and start.mu.device.type == "cpu" and n_samples <= MOST_SAMPLES:
        blocks = precision.W is None or descent.kl == "diagonal"
        kind = Blocked if blocks and start.mu.shape[2] >= MANY else Fused
    return kind(start, precision, descent, noise, n_samples)


def _diagonal(
    start: Start, precision: Precision, descent: Descent, noise: Stream, n_samples: int
) -> Posterior:
    """A diagonal covariance, with one line in the log where its step may destroy a network."""
    if descent.alpha > CALM:
        LOGGER.warning(
            "alpha_L = %g is a large step on a diagonal: of a network it can destroy what sources "
            "know, which %g did not",
            descent.alpha,
            CALM,
        )
    return Diagonal(start, precision, descent, noise, n_samples)


Maker = Callable[[Start, Precision, Descent, Stream, int], Posterior]

#: A family of posteriors is chosen by its name here; a new one is a class and a line.
COVARIANCES: dict[str, Maker] = {
    "full": _full,
    "dense": Dense,
    "diagonal": _diagonal,
    "fixed": Fixed,
}
