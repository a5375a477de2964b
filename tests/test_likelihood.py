"""Return against likelihood: the density, and runs that are gathered by their task."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from vtlib.claims import Returns
from vtlib.experiments import ROOMS_LIKELIHOOD, ROOMS_LIKELIHOOD_SLIDERS, likelihood
from vtlib.experiments.experiment import slider_name
from vtlib.experiments.likelihood import (
    _first_runs,
    density,
    draw_tasks,
    share_by_task,
    slider_picture,
    task_likelihood,
)
from vtlib.experiments.rooms import LIKELIHOOD_DOORS
from vtlib.stats import mean_interval

PROPERTY = settings(deadline=None, derandomize=True)
# Three tasks of four runs each, and sliders that ran once on each for half as long.
SHARED = replace(ROOMS_LIKELIHOOD, name="shared", runs=12, runs_per_task=4, iterations=400)
SLIDERS = replace(ROOMS_LIKELIHOOD_SLIDERS, name="shared-sliders", runs=3, iterations=200)
DOORS = np.array([2.0, 5.0, 8.5])
AT = np.array([100, 200, 300, 400])
# What a run earned tells which run it was, and when.
EARNED = np.arange(12)[:, None] / 100 + AT / 1e6


def test_the_density_is_that_of_a_normal_distribution():
    doors = np.linspace(0.5, 9.5, 37)
    normal = torch.distributions.Normal(*(torch.tensor(x).double() for x in LIKELIHOOD_DOORS))
    expected = normal.log_prob(torch.from_numpy(doors)).exp().numpy()
    np.testing.assert_allclose(density(doors), expected, rtol=1e-6)


def test_the_density_integrates_to_one():
    doors = np.linspace(-10, 20, 30_001)
    assert np.trapezoid(density(doors), doors) == pytest.approx(1, abs=1e-6)


@PROPERTY
@given(st.floats(-4, 4), st.floats(-4, 4))
def test_a_door_nearer_the_mean_is_likelier(one, other):
    mean, _ = LIKELIHOOD_DOORS
    near, far = sorted((one, other), key=abs)
    # up to the rounding of what lies on either side
    assert density(mean + near) >= density(mean + far) * (1 - 1e-9)
    assert density(mean + near) == pytest.approx(density(mean - near))


@pytest.fixture
def stored(monkeypatch) -> None:
    """Stored results of both experiments, made up."""

    def returns(name: str, label: str) -> Returns:
        if name == SHARED.name:
            assert label in SHARED.algorithms
            return Returns(AT, EARNED, EARNED + 0.5, 0.5 + 0.1 * np.repeat(np.arange(3), 4))
        assert (name, label) == (SLIDERS.name, slider_name(1e-6, 0.5, 1))
        mine = np.array([[0.1, 0.2], [0.1, 0.3], [0.1, 0.7]])
        return Returns(AT[:2], mine, mine, 0.5 + 0.1 * np.arange(3))

    def load(name: str, label: str, root: object) -> tuple[dict, dict]:
        assert (name, label) == (SHARED.name, "tasks")
        return {"doors": np.repeat(DOORS, 4)[:, None]}, {}

    monkeypatch.setattr(likelihood, "returns", returns)
    monkeypatch.setattr(likelihood, "load_result", load)


@pytest.mark.usefixtures("stored")
def test_each_task_has_one_likelihood():
    np.testing.assert_array_equal(task_likelihood(SHARED), density(DOORS))


@pytest.mark.usefixtures("stored")
def test_a_row_holds_the_shares_of_one_tasks_runs():
    shares = share_by_task(SHARED, "GVT", 300)
    assert shares.shape == (3, 4)
    for run in range(12):
        expected = (run / 100 + 0.0003) / (0.5 + 0.1 * (run // 4))
        assert shares[run // 4, run % 4] == pytest.approx(expected)


@pytest.mark.usefixtures("stored")
def test_the_reference_is_the_first_run_of_each_task_for_as_long_as_the_sliders():
    first = _first_runs(SHARED, "GVT", SLIDERS)
    runs = [0, 4, 8]
    assert list(first.iterations) == [100, 200]
    np.testing.assert_array_equal(first.learning, EARNED[runs, :2])
    np.testing.assert_array_equal(first.greedy, EARNED[runs, :2] + 0.5)
    np.testing.assert_allclose(first.optimum, [0.5, 0.6, 0.7])


def test_the_books_sliders_pair_with_the_first_runs_task_by_task():
    tasks = ROOMS_LIKELIHOOD.runs // ROOMS_LIKELIHOOD.runs_per_task
    assert ROOMS_LIKELIHOOD_SLIDERS.runs == tasks
    first = range(0, ROOMS_LIKELIHOOD.runs, ROOMS_LIKELIHOOD.runs_per_task)
    assert [ROOMS_LIKELIHOOD.task_of(run) for run in first] == [
        ROOMS_LIKELIHOOD_SLIDERS.task_of(run) for run in range(tasks)
    ]
    assert ROOMS_LIKELIHOOD_SLIDERS.stream == ROOMS_LIKELIHOOD.stream
    assert ROOMS_LIKELIHOOD_SLIDERS.every == ROOMS_LIKELIHOOD.every


def test_tasks_are_drawn_from_unlikely_to_likely_each_with_its_interval():
    ax = Figure().subplots()
    likely = np.array([0.2, 0.05, 0.1])
    shares = np.array([[0.8, 0.9, 1.0], [0.1, 0.5, 0.3], [0.6, 0.6, 0.9]])
    draw_tasks(ax, "GVT", likely, shares)
    (line,) = [line for line in ax.lines if line.get_marker() == "o"]
    order = [1, 2, 0]
    np.testing.assert_allclose(line.get_xdata(), likely[order])
    np.testing.assert_allclose(line.get_ydata(), shares[order].mean(1))
    (bars,) = ax.containers[0].lines[2]
    drawn = [tuple(segment[:, 1]) for segment in bars.get_segments()]
    bands = [mean_interval(row) for row in shares[order]]
    np.testing.assert_allclose(drawn, [(band.low, band.high) for band in bands])


@pytest.mark.usefixtures("stored")
def test_a_sliders_picture_says_its_setting_and_what_it_earned():
    html = slider_picture(SHARED, SLIDERS, 1e-6, 0.5, 1)
    alt = re.search(r'alt="([^"]*)"', html).group(1)
    assert "lambda = 1e-06, psi = 0.5, 1 component;" in alt
    earned = np.mean([0.2 / 0.5, 0.3 / 0.6, 0.7 / 0.7])
    assert f"mean share of the optimum after 200 iterations {earned:.2f}." in alt
