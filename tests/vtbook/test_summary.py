"""Numbers that several pages quote: how they are pooled, and that a tally has each fact once."""

import pytest

from vtbook import summary


def test_mazes_as_observations_have_the_runs_mean_and_a_wider_interval():
    gaps = summary.mazes_over_nothing()
    runs, mazes = gaps["as published"], gaps["by maze"]
    assert mazes.centre == pytest.approx(runs.centre, abs=1e-6)  # all mazes have as many runs
    assert mazes.low < runs.low < runs.high < mazes.high


def test_verdicts_add_up_to_the_facts_which_are_fewer_than_their_rows():
    counts = summary.counts()
    every, rows = counts.pop("all"), counts.pop("rows")
    assert sum(counts.values()) == every < rows
