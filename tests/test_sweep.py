"""The table of λ and ψ: the sliders' runs at their end."""

from __future__ import annotations

import re

import numpy as np
import pytest

from vtlib.claims import Returns
from vtlib.experiments import ROOMS_EVALUATION, ROOMS_SLIDERS, sweep
from vtlib.experiments.experiment import PSIS, slider_lambdas, slider_name
from vtlib.experiments.reading import returns
from vtlib.experiments.sweep import NO_BREAK, final_shares, sweep_table
from vtlib.stats import mean_interval

LAMBDAS = slider_lambdas(ROOMS_EVALUATION.algorithms["1-MGVT"])


def rows_of(html: str) -> list[list[str]]:
    rows = re.findall(r"<tr>(.*?)</tr>", html.replace(NO_BREAK, " "))
    return [re.findall(r"<t[hd]>(.*?)</t[hd]>", row) for row in rows]


@pytest.mark.parametrize("components", [1, 3])
def test_shares_are_those_of_the_last_stored_returns(components: int):
    shares = final_shares(ROOMS_EVALUATION, ROOMS_SLIDERS, components)
    assert set(shares) == {(x, psi) for x in LAMBDAS for psi in PSIS}
    runs = returns(ROOMS_SLIDERS.name, slider_name(LAMBDAS[3], 0.5, components))
    expected = runs.at(ROOMS_SLIDERS.iterations) / runs.optimum
    assert np.array_equal(shares[LAMBDAS[3], 0.5], expected)


def test_the_table_holds_each_setting_once():
    head, *rows = rows_of(sweep_table(ROOMS_EVALUATION, ROOMS_SLIDERS, 1))
    assert head == ["", "λ = 10⁻⁸", "λ = 10⁻⁷", "λ = 10⁻⁶", "λ = 10⁻⁵", "λ = 10⁻⁴"]
    assert [row[0] for row in rows] == ["ψ = 0", "ψ = 0.5", "ψ = 1"]
    shares = final_shares(ROOMS_EVALUATION, ROOMS_SLIDERS, 1)
    for psi, row in zip(PSIS, rows, strict=True):
        for lambda_, cell in zip(LAMBDAS, row[1:], strict=True):
            band = mean_interval(shares[lambda_, psi])
            assert cell == f"{band.centre:.2f} ± {band.high - band.centre:.2f}"


def test_other_runs_make_another_table(monkeypatch):
    def made(name: str, label: str) -> Returns:
        level = 0.2 if label == slider_name(LAMBDAS[0], 1.0, 2) else 0.4
        earned = np.full((3, 2), level) * [0.5, 1.0]
        return Returns(np.array([1, 2]), earned, earned, np.full(3, 0.8))

    monkeypatch.setattr(sweep, "returns", made)
    _, *rows = rows_of(sweep_table(ROOMS_EVALUATION, ROOMS_SLIDERS, 2))
    assert [row[1:] for row in rows] == [
        ["0.50 ± 0.00"] * 5,
        ["0.50 ± 0.00"] * 5,
        ["0.25 ± 0.00", *["0.50 ± 0.00"] * 4],
    ]
