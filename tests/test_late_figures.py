"""Why transfer falls late: what is read off the probes, and the figure of the stored runs."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest

from vtlib.experiments import CARTPOLE, CARTPOLE_LATE, CARTPOLE_LATE_AGAIN
from vtlib.experiments.control import LATE_VARIANTS
from vtlib.experiments.late_figures import (
    LATE_COLOURS,
    MARKERS,
    THESIS,
    all_outcomes,
    bound_table,
    growth,
    intact,
    largest_step,
    late_figure,
    late_runs,
    outcomes,
    step_after,
)
from vtlib.experiments.reading import optimum
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


def test_a_run_has_fallen_that_ends_below_nine_tenths_of_its_own_optimum():
    best = optimum(CARTPOLE_LATE.name)[[4, 2, 7]]
    ends = np.array([0.91, 0.89, 0.5]) * best
    learning = np.stack([best, best / 2, best, ends], 1)
    above, exploded, fallen = outcomes(
        CARTPOLE_LATE, {**PROBED, "run": np.array([4, 2, 7]), "learning": learning}
    )
    np.testing.assert_array_equal(above, [False] * 3)
    np.testing.assert_array_equal(exploded, [False, False, True])
    np.testing.assert_array_equal(fallen, [False, True, True])


BOTH = {"first": CARTPOLE_LATE, "again": CARTPOLE_LATE_AGAIN}


def test_the_table_counts_the_runs_of_each_experiment():
    lines = re.findall(r"<tr>(.*?)</tr>", bound_table(BOTH))
    head, *rows = [re.findall(r"<t[hd]>(.*?)</t[hd]>", line) for line in lines]
    assert head == ["", *BOTH]
    for column, experiment in enumerate(BOTH.values(), 1):
        counts = [int(row[column]) for row in rows]
        runs, above, above_exploded, below, below_exploded, fallen, fallen_exploded = counts
        assert runs == above + below == experiment.runs * len(experiment.algorithms)
        exploded = sum((growth(x) > 100).sum() for x in late_runs(experiment).values())
        assert above_exploded + below_exploded == exploded
        assert fallen_exploded <= min(fallen, exploded)
        lost = [
            (x["learning"][:, -1] < 0.9 * optimum(experiment.name)).sum()
            for x in late_runs(experiment).values()
        ]
        assert fallen == sum(lost)


def test_what_the_pages_say_of_the_bound():
    found = [all_outcomes(experiment) for experiment in BOTH.values()]
    for above, exploded, _ in found:
        assert not (exploded & ~above).any()
        assert (above & ~exploded).any()
    above, exploded, fallen = (np.concatenate(x) for x in zip(*found, strict=True))
    assert (fallen & exploded).sum() > (fallen & ~exploded).sum() > 0
    for experiment in BOTH.values():
        runs = late_runs(experiment)
        _, exploded, fallen = outcomes(experiment, runs["GVT", THESIS])
        assert fallen.any()
        assert not (fallen & ~exploded).any()
        for label, remedy in itertools.product(MARKERS, ("smaller steps on L", "full gradient")):
            assert not outcomes(experiment, runs[label, remedy]).fallen.any()


def test_every_run_is_a_point_of_the_figure():
    stored = late_runs(CARTPOLE_LATE)
    assert len(stored) == len(CARTPOLE_LATE.algorithms)
    gvt, mgvt, steps, every = late_figure(CARTPOLE_LATE, CARTPOLE_LATE_AGAIN).axes
    assert gvt.get_legend_handles_labels()[1] == [*LATE_VARIANTS, "planned optimum"]
    assert len(gvt.get_lines()) == len(mgvt.get_lines()) == len(LATE_VARIANTS) + 1
    exploded = [~intact(stored[label, THESIS]).all(1) for label in MARKERS]
    lines = 2 * CARTPOLE_LATE.runs + np.concatenate(exploded).sum()
    assert len(steps.get_lines()) == lines + 1  # the dotted one
    points = [line for line in every.get_lines() if line.get_marker() in MARKERS.values()]
    hollow = [line for line in points if line.get_markerfacecolor() == "none"]
    for marks, experiment in ((hollow, CARTPOLE_LATE), (points, CARTPOLE_LATE_AGAIN)):
        drawn = sorted(x for line in marks for x in line.get_xdata())
        largest = [largest_step(x) for x in late_runs(experiment).values()]
        assert set(np.concatenate(largest)) <= set(drawn)
    count = CARTPOLE_LATE.runs + CARTPOLE_LATE_AGAIN.runs
    assert sum(len(line.get_xdata()) for line in points) == count * len(stored)


def test_no_variant_has_the_colour_of_an_algorithm():
    assert not set(LATE_COLOURS.values()) & set(COLOURS.values())
