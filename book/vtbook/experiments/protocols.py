"""What the published figures were drawn with, where that departs from the thesis' equations.

The thesis' figures were drawn with its authors' code of 2018, which departs from the thesis' text
in a few places. Each is a field of ``Settings``, ``Experiment`` or a task family; those of a
posterior are here.
"""

from collections.abc import Sequence

from attrs import evolve

from vtlab.experiment import Algorithm, Experiment
from vtlib.baselines import DDQNSettings, FineTuning, MellowTDSettings
from vtlib.checks import check_kind
from vtlib.transfer import Settings

KL_CLIP = 100.0
# Fine-tuning by its labels: from one source, or from the mean of all.
FINE_TUNED, FROM_MEAN = "fine-tuned source", "fine-tuned mean"


def transfer_settings(experiment: Experiment, label: str) -> Settings:
    """The settings of an algorithm that transfers; ValueError when it is another one."""
    settings = experiment.algorithms[label]
    check_kind(f"algorithms[{label!r}]", settings, Settings)
    assert isinstance(settings, Settings)
    return settings


def as_published(settings: Settings) -> Settings:
    """Settings by the equations, changed to those that the published code runs with.

    GVT starts at the sources' mean with their covariance over S - 1, next to no variance elsewhere,
    and a bound on the divergence's gradient. All components of a mixture start at the mean, their
    responsibilities are equal, and only the diagonal of L feels the divergence.
    """
    if settings.family == "gaussian":
        return evolve(settings, init="span", ddof=1, kl_clip=KL_CLIP)
    return evolve(settings, init="mean", responsibilities="equal", kl="diagonal")


def one_at_a_time(gaussian: Settings, mixture: Settings) -> dict[str, Algorithm]:
    """Published settings of GVT and 1-MGVT with one ingredient each as the equations have it."""
    return {
        "GVT, no clip": evolve(gaussian, kl_clip=None),
        "GVT, from the prior": evolve(gaussian, init="sources"),
        "GVT, covariance with n": evolve(gaussian, ddof=0),
        "1-MGVT, from a source": evolve(mixture, init="sources"),
        "1-MGVT, exact responsibilities": evolve(mixture, responsibilities="exact"),
        "1-MGVT, full KL": evolve(mixture, kl="full"),
    }


def transfer(
    gaussian: Settings, mixture: Settings, counts: Sequence[int] = (3,)
) -> dict[str, Algorithm]:
    """GVT, 1-MGVT and mixtures of so many components by their labels, the longest first."""
    mixtures = {f"{c}-MGVT": evolve(mixture, components=c) for c in counts}
    return {**mixtures, "GVT": gaussian, "1-MGVT": mixture}


def fine_tuning(learner: MellowTDSettings | DDQNSettings) -> dict[str, Algorithm]:
    """A learner without transfer, started from sources, by the labels above."""
    # hardly explores: what its start knows is all that it has
    greedy = evolve(learner, epsilon_start=learner.epsilon_end)
    return {FINE_TUNED: FineTuning(greedy), FROM_MEAN: FineTuning(greedy, "mean")}
