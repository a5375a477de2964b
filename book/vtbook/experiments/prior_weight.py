"""How hard a prior should hold: the return in the rooms against its weight, lambda / sigma^2.

The divergence pulls the posterior's mean to the prior's with this weight. sigma^2 is the variance
of the prior: sigma_p2 of a mixture's components, and of a Gaussian the jitter, which is its
variance wherever the sources say nothing.
"""

from __future__ import annotations

from attrs import evolve

from vtbook.experiments.controls import POINT
from vtbook.experiments.protocols import FROM_MEAN, transfer_settings
from vtbook.experiments.rooms import ROOMS_CHANGE, ROOMS_EVALUATION, ROOMS_LIKELIHOOD
from vtlab.experiment import Algorithm, Experiment

WEIGHTS = (1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0)  # the published are .1 of 1-MGVT and 10 of GVT
POSTERIORS = ("GVT", "1-MGVT", "1-MGVT, frozen", "point")
SETTINGS = [(posterior, weight) for posterior in POSTERIORS for weight in WEIGHTS]
ITERATIONS = 4_000


def labelled(posterior: str, weight: float) -> str:
    """The label of a posterior under a prior of some weight."""
    return f"{posterior}, weight {weight:g}"


def weighted(experiment: Experiment, runs: int, runs_per_task: int = 1) -> Experiment:
    """A page's experiment with each posterior under priors of all weights, and the start alone."""
    mixture, gaussian = (transfer_settings(experiment, label) for label in ("1-MGVT", "GVT"))
    frozen = evolve(mixture, covariance="fixed")
    point = evolve(frozen, sigma_p2=POINT**2)
    algorithms: dict[str, Algorithm] = {FROM_MEAN: experiment.algorithms[FROM_MEAN]}
    for weight in WEIGHTS:
        for posterior, settings in zip(POSTERIORS, (gaussian, mixture, frozen, point), strict=True):
            variance = settings.jitter if posterior == "GVT" else settings.sigma_p2
            algorithms[labelled(posterior, weight)] = evolve(settings, lambda_=weight * variance)
    return evolve(
        experiment,
        name=f"{experiment.name}-prior-weight",
        algorithms=algorithms,
        runs=runs,
        runs_per_task=runs_per_task,
        iterations=ITERATIONS,
        greedy=False,
    )


PRIOR_WEIGHT = {
    "rooms_evaluation": weighted(ROOMS_EVALUATION, 60),
    "rooms_distribution_change": weighted(ROOMS_CHANGE, 60),
    "rooms_likelihood": weighted(ROOMS_LIKELIHOOD, 76, 4),
}
