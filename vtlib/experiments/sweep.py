"""What λ and ψ do: the return at the end of the sliders' runs, as a table."""

from __future__ import annotations

import numpy as np

from vtlib.experiments.experiment import PSIS, Experiment, slider_lambdas, slider_name
from vtlib.experiments.protocol import html_table
from vtlib.experiments.reading import returns
from vtlib.plots import power_of_ten
from vtlib.stats import mean_interval

NO_BREAK = "\N{NO-BREAK SPACE}"


def final_shares(
    experiment: Experiment, sliders: Experiment, components: int
) -> dict[tuple[float, float], np.ndarray]:
    """Share of each task's optimum (R,) that is earned at the end, by (lambda, psi)."""
    base = experiment.transfer_settings("1-MGVT")
    shares = {}
    for psi in PSIS:
        for lambda_ in slider_lambdas(base):
            runs = returns(sliders.name, slider_name(lambda_, psi, components))
            shares[lambda_, psi] = runs.learning[:, -1] / runs.optimum
    return shares


def sweep_table(experiment: Experiment, sliders: Experiment, components: int) -> str:
    """Mean share of the optimum at the end with its 95 % interval, as HTML: ψ down, λ across."""
    shares = final_shares(experiment, sliders, components)
    lambdas = slider_lambdas(experiment.transfer_settings("1-MGVT"))
    head = ["", *(f"λ{NO_BREAK}={NO_BREAK}{power_of_ten(x)}" for x in lambdas)]
    rows = [
        [f"ψ{NO_BREAK}={NO_BREAK}{psi:g}", *(_share(shares[x, psi]) for x in lambdas)]
        for psi in PSIS
    ]
    return html_table(head, rows)


def _share(values: np.ndarray) -> str:
    band = mean_interval(values)
    half = float(band.high - band.centre)
    return f"{float(band.centre):.2f}{NO_BREAK}±{NO_BREAK}{half:.2f}"
