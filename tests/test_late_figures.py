"""Why transfer falls late: what is read off the probes, and the figure of the stored runs."""

from __future__ import annotations

import numpy as np
import pytest

from vtlib.experiments import CARTPOLE, CARTPOLE_LATE
from vtlib.experiments.control import LATE_VARIANTS
from vtlib.experiments.late_figures import (
    LATE_COLOURS,
    MARKERS,
    THESIS,
    growth,
    intact,
    largest_step,
    late_figure,
    late_runs,
    step_after,
)
from vtlib.experiments.work import load_result
from vtlib.plots import COLOURS
from vtlib.store import results_folder

PROBED = {
    "spread": np.array([[1.0, 2.0, 90.0, 5.0], [1.0, 2.0, 200.0, 4.0], [2.0, 1.0, 1.0, 600.0]]),
    "step": np.array([[0.1, 0.2, 0.3, 0.2], [0.1, 0.9, 70.0, 0.2], [0.5, 0.4, 0.3, 9.0]]),
}


def test_growth_is_of_the_last_spread_over_the_first():
    np.testing.assert_allclose(growth(PROBED), [5, 4, 300])


def test_the_largest_step_is_taken_before_the_spread_explodes_even_if_it_shrinks_again():
    np.testing.assert_allclose(largest_step(PROBED), [0.3, 0.9, 0.5])


def test_a_run_that_has_exploded_is_never_intact_again():
    expected = [[True] * 4, [True, True, False, False], [True, True, True, False]]
    np.testing.assert_array_equal(intact(PROBED), expected)


def test_the_step_after_some_iterations_is_near_the_stored_one():
    pool, _ = load_result(CARTPOLE.pool.name, "sources", results_folder())
    stored = late_runs(CARTPOLE_LATE)["1-MGVT", THESIS]
    found = step_after(CARTPOLE, "1-MGVT", CARTPOLE_LATE.every, pool["weights"])
    # of another draw of remembered transitions than the stored one
    assert found == pytest.approx(float(stored["step"][0, 0]), rel=0.1)


@pytest.mark.parametrize("label", MARKERS)
def test_the_runs_as_in_the_thesis_are_those_of_the_figure(label):
    here, _ = load_result(CARTPOLE_LATE.name, f"{label}, as in the thesis", results_folder())
    there, _ = load_result(CARTPOLE.name, label, results_folder())
    among = np.ix_(range(CARTPOLE_LATE.runs), np.isin(there["iterations"], here["iterations"]))
    np.testing.assert_array_equal(here["learning"], there["learning"][among])


def test_every_run_is_a_point_of_the_figure():
    stored = late_runs(CARTPOLE_LATE)
    assert len(stored) == len(CARTPOLE_LATE.algorithms)
    gvt, mgvt, steps, every = late_figure(CARTPOLE_LATE).axes
    assert gvt.get_legend_handles_labels()[1] == [*LATE_VARIANTS, "planned optimum"]
    assert len(gvt.get_lines()) == len(mgvt.get_lines()) == len(LATE_VARIANTS) + 1
    exploded = [~intact(stored[label, THESIS]).all(1) for label in MARKERS]
    lines = 2 * CARTPOLE_LATE.runs + np.concatenate(exploded).sum()
    assert len(steps.get_lines()) == lines + 1  # the dotted one
    points = [line for line in every.get_lines() if line.get_marker() in MARKERS.values()]
    assert sum(len(line.get_xdata()) for line in points) == CARTPOLE_LATE.runs * len(stored)


def test_no_variant_has_the_colour_of_an_algorithm():
    assert not set(LATE_COLOURS.values()) & set(COLOURS.values())
