"""Grids of settings around the thesis', over which a page has sliders."""

import itertools
from collections.abc import Mapping, Sequence

from attrs import evolve

from vtbook.experiments.protocols import transfer_settings
from vtlab.experiment import Experiment
from vtlib.transfer import Settings

PSIS = (0.0, 0.5, 1.0)
POSTERIORS = ("GVT", "1-MGVT", "2-MGVT", "3-MGVT")


def count_name(algorithm: str, count: int) -> str:
    """The name under which an algorithm with so many sources is stored."""
    return f"{algorithm}-from-{count}"


def slider_name(lambda_: float, psi: float, posterior: str) -> str:
    """The name under which one setting of the sliders is stored."""
    return f"{posterior}-lambda-{lambda_:.0e}-psi-{psi:g}"


def slider_settings(
    thesis: Mapping[str, Settings], lambda_: float, psi: float, posterior: str
) -> Settings:
    """One setting of the sliders around the thesis' of "GVT" and "1-MGVT"."""
    if posterior == "GVT":
        return evolve(thesis["GVT"], lambda_=lambda_, psi=psi)
    components = int(posterior.removesuffix("-MGVT"))
    return evolve(thesis["1-MGVT"], lambda_=lambda_, psi=psi, components=components)


def slider_thesis(experiment: Experiment) -> dict[str, Settings]:
    """The thesis' settings around which sliders move."""
    return {label: transfer_settings(experiment, label) for label in ("GVT", "1-MGVT")}


def sliders_of(
    experiment: Experiment, name: str, runs: int, iterations: int, lambdas: Sequence[float]
) -> Experiment:
    """The settings of the sliders around GVT and 1-MGVT, on an experiment's first runs or tasks."""
    thesis = slider_thesis(experiment)
    return evolve(
        experiment,
        name=name,
        algorithms={
            slider_name(*setting): slider_settings(thesis, *setting)
            for setting in itertools.product(lambdas, PSIS, reversed(POSTERIORS))
        },
        runs=runs,
        iterations=iterations,
        runs_per_task=1,
    )
