"""What the posterior buys: transfer with one part after another taken away, paired run by run.

A point that starts at the sources' mean is the start alone. The weight of the prior on its mean
is added to it, then the fixed spread of the samples, and then a covariance that is learned, which
is the method as published. Tasks, sources and random numbers are those of the pages, continued to
more runs. What is compared is the learning return over the whole course.
"""

from __future__ import annotations

from typing import Any

from attrs import evolve

from vtbook.experiments.cartpole import CARTPOLE
from vtbook.experiments.maze import MAIN, MAZE_TARGETS
from vtbook.experiments.mountain_car import CAR
from vtbook.experiments.protocols import FROM_MEAN, transfer_settings
from vtbook.experiments.rooms import ROOMS_CHANGE, ROOMS_EVALUATION, ROOMS_LIKELIHOOD
from vtbook.neighbours import AnchoredSettings
from vtlab.experiment import Algorithm, Experiment
from vtlib.transfer import Settings

POINT = 1e-4  # deviation of the samples that stand for a point
FROZEN = 1e-20  # steps on a Gaussian's L that float32 cannot tell from none


def without_parts(mixture: Settings) -> dict[str, Settings]:
    """A mixture with a frozen covariance, as a point under the same pull, and without that pull."""
    frozen = evolve(mixture, covariance="fixed")
    # The weight of the prior on the mean is lambda / sigma^2: the same for the point.
    share = POINT**2 / mixture.sigma_p2
    point = evolve(frozen, sigma_p2=POINT**2, lambda_=mixture.lambda_ * share)
    return {"frozen": frozen, "point": point, "start alone": evolve(point, lambda_=0.0)}


def variants(experiment: Experiment) -> dict[str, Algorithm]:
    """1-MGVT and GVT of an experiment, without their parts; and fine-tuning of the mean."""
    mixture, gaussian = (transfer_settings(experiment, label) for label in ("1-MGVT", "GVT"))
    parts = without_parts(mixture)
    return {
        "1-MGVT": mixture,
        "1-MGVT, frozen": parts["frozen"],
        "1-MGVT, point": parts["point"],
        "1-MGVT, point of 1 sample": evolve(parts["point"], n_samples=1),
        "1-MGVT, start alone": parts["start alone"],
        "1-MGVT, lambda 0": evolve(mixture, lambda_=0.0),
        "GVT": gaussian,
        "GVT, frozen": evolve(gaussian, alpha_L=FROZEN),
        "GVT, lambda 0": evolve(gaussian, lambda_=0.0),
        FROM_MEAN: experiment.algorithms[FROM_MEAN],
    }


def control(experiment: Experiment, runs: int, iterations: int, **fields: Any) -> Experiment:
    """The controls of a page's experiment, on its own streams of random numbers."""
    return evolve(
        experiment,
        name=f"{experiment.name}-controls",
        algorithms=variants(experiment),
        runs=runs,
        iterations=iterations,
        greedy=False,
        **fields,
    )


# By page: as many runs as decide there, at the length within which methods differ.
CONTROLS = {
    "rooms_evaluation": control(ROOMS_EVALUATION, 120, 5_000),
    "rooms_distribution_change": control(ROOMS_CHANGE, 120, 5_000),
    "rooms_likelihood": control(ROOMS_LIKELIHOOD, 190, 4_000, runs_per_task=10),
    "cartpole": control(CARTPOLE, 100, 3_000),
    "mountain_car": control(CAR, 40, 10_000),
    "mazes": control(MAZE_TARGETS[MAIN], 10, 10_000),
}

# The main contrasts with sources that another seed has drawn and solved, on the same targets.
MAIN_CONTRASTS = ("1-MGVT", "1-MGVT, frozen", "1-MGVT, point", "GVT", FROM_MEAN)


def with_other_sources(experiment: Experiment, runs: int) -> Experiment:
    """The main contrasts of a page's controls from a second pool of sources."""
    return evolve(
        experiment,
        name=f"{experiment.name}-second-pool",
        pool=evolve(experiment.pool, name=f"{experiment.pool.name}-second", stream="second pool"),
        algorithms={label: experiment.algorithms[label] for label in MAIN_CONTRASTS},
        runs=runs,
    )


SECOND_POOLS = {
    page: with_other_sources(CONTROLS[page], runs)
    for page, runs in {"rooms_evaluation": 120, "cartpole": 100, "mountain_car": 40}.items()
}


# Why the pull helps. Before any of these runs we expected it to help where the new task has given
# no data: pulling the unseen weights alone earns nearly as much as pulling all, pulling the seen
# ones alone nearly nothing, and so does holding the unseen still, without a pull. A weight of the
# linear rooms belongs to one place and one action. How much data is "enough" was fixed at 1, a
# visit to the middle of its base; a tenth and ten times as much are there to see what that changes.
ENOUGH = (1.0, 0.1, 10.0)
# When these runs had been seen, and before the next, we asked what moves unseen weights. Adam's
# steps are about as long however small a gradient is, so traces of features that reach a weight
# from afar would do. A larger epsilon keeps such a weight where it is. If so, it should gain
# without a pull about what the pull gains, and a pull should then add little.
EPSILONS = (1e-5, 1e-4, 1e-3)


def _anchored(mixture: Settings) -> dict[str, Algorithm]:
    """One vector under the pull of a mixture, in some places or everywhere."""
    td = {name: getattr(mixture, name) for name in ("psi", "kappa", "gamma", "minibatch", "buffer")}
    pulled = AnchoredSettings(
        strength=mixture.lambda_ / mixture.sigma_p2, alpha=mixture.alpha_mu, **td
    )
    free = evolve(pulled, strength=0.0)
    found: dict[str, Algorithm] = {"no pull": free, "pull": pulled}
    for enough in ENOUGH:
        of = "" if enough == 1 else f", {enough:g}"
        found[f"pull on the unseen{of}"] = evolve(pulled, pull="unseen", enough=enough)
        found[f"pull on the seen{of}"] = evolve(pulled, pull="seen", enough=enough)
        found[f"unseen held{of}"] = evolve(free, held=True, enough=enough)
    for epsilon in EPSILONS:
        for name, settings in (("no pull", free), ("pull", pulled)):
            found[f"{name}, epsilon {epsilon:g}"] = evolve(settings, epsilon=epsilon)
    return found


# On the tasks and streams of the controls.
WHERE_PULLED = {
    page: evolve(
        CONTROLS[page],
        name=f"{CONTROLS[page].name}-where",
        algorithms=_anchored(transfer_settings(CONTROLS[page], "1-MGVT")),
    )
    for page in ("rooms_evaluation", "rooms_distribution_change", "rooms_likelihood")
}
