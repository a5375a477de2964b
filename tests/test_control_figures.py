"""The control pages' figures, and their claims on the stored runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vtlib.claims import NOT, REPRODUCED, Returns, moves_early, not_by, starts_near_optimum
from vtlib.experiments import CARTPOLE, CARTPOLE_COLLAPSE, CARTPOLE_OTHER_SOURCES
from vtlib.experiments.control_figures import (
    VARIANTS,
    collapse_figure,
    other_sources_figure,
    values_and_gaps,
)
from vtlib.experiments.reading import returns


def test_other_sources_are_compared_for_as_long_as_all_ran():
    experiments = {"mellow": CARTPOLE, "ddqn": CARTPOLE_OTHER_SOURCES["ddqn-common"]}
    figure = other_sources_figure(experiments, ["GVT", "1-MGVT"])
    assert [ax.get_title(loc="left") for ax in figure.axes] == list(experiments)
    for ax, experiment in zip(figure.axes, experiments.values(), strict=True):
        line = ax.get_lines()[0]
        assert line.get_xdata()[-1] == 2_000
        expected = returns(experiment.name, "GVT").learning.mean(0)[:20]
        np.testing.assert_allclose(line.get_ydata(), expected, rtol=1e-6)


def test_values_and_gaps_of_linear_networks(monkeypatch):
    pool = CARTPOLE.pool
    weights = np.zeros((2, 226), np.float32)
    # the output's biases are the last two weights: constant values
    weights[:, -2:] = [[3.0, 1.0], [-2.0, 5.0]]
    monkeypatch.setattr("vtlib.experiments.control_figures.pool_weights", lambda *_: weights)
    value, gap = values_and_gaps(pool)
    np.testing.assert_allclose(value, [3, 5])
    np.testing.assert_allclose(gap, [2, 7])


def test_the_collapse_shows_every_source_and_every_variant():
    base = CARTPOLE_OTHER_SOURCES["ddqn-common"]
    pools = {"mellow TD": CARTPOLE.pool, "DDQN": base.pool}
    figure = collapse_figure(pools, base, CARTPOLE_COLLAPSE, "1-MGVT")
    left, right = figure.axes
    assert [len(line.get_xdata()) for line in left.get_lines()[:2]] == [100, 100]
    names = right.get_legend_handles_labels()[1]
    assert names == ["as in the thesis", *VARIANTS, "planned optimum"]
    assert set(VARIANTS) == set(CARTPOLE_COLLAPSE.algorithms)


@pytest.fixture(scope="module")
def stored() -> dict[str, Returns]:
    return {label: returns("cartpole", label) for label in ("DDQN", "1-MGVT")}


def test_stored_runs_exchanged_make_the_claims_fail(stored):
    assert starts_near_optimum("1-MGVT", stored["1-MGVT"]).verdict == REPRODUCED
    assert starts_near_optimum("1-MGVT", stored["DDQN"]).verdict == NOT
    assert not_by("DDQN", stored["DDQN"], 2_000).verdict == REPRODUCED
    assert not_by("DDQN", stored["1-MGVT"], 2_000).verdict == NOT


def test_a_stored_greedy_curve_that_stands_still_early_moves_late(stored):
    still = stored["DDQN"].greedy.copy()
    still[:, :20] = still[:, :1]
    late = replace(stored["DDQN"], greedy=still)
    assert moves_early("DDQN", late, 2_000).verdict == NOT
