"""The two protocols of every experiment: as its figure was published, and by the equations.

The thesis' figures were drawn with its authors' code of 2018, which departs from the thesis' text
in a few places. Each is a field of ``Settings``, ``Experiment`` or a task family; those of a
posterior are here.
"""

from __future__ import annotations

from typing import NamedTuple

from attrs import evolve

from vtlib.experiments.experiment import Experiment
from vtlib.transfer import Settings

KL_CLIP = 100.0
# Fine-tuning by its labels: from one source, exploring as without transfer or hardly; or the mean.
FINE_TUNED, FINE_TUNED_GREEDY, FROM_MEAN = "fine-tuned", "fine-tuned, greedy", "fine-tuned mean"


class Protocols(NamedTuple):
    """One experiment in both protocols, on the same streams of random numbers."""

    published: Experiment
    equations: Experiment


def as_published(settings: Settings) -> Settings:
    """Settings by the equations, changed to those that the published code runs with.

    GVT starts at the sources' mean with their covariance over S - 1, next to no variance elsewhere,
    and a bound on the divergence's gradient. All components of a mixture start at the mean, their
    responsibilities are equal, and only the diagonal of L feels the divergence.
    """
    if settings.family == "gaussian":
        return evolve(settings, init="span", ddof=1, kl_clip=KL_CLIP)
    return evolve(settings, init="mean", responsibilities="equal", kl="diagonal")
