"""The page of an experiment: its stored runs, what they cost, and numbers for its text."""

from unittest.mock import Mock

import numpy as np
import pytest

from vtbook import page as module
from vtbook.costs import cost
from vtbook.experiments.mountain_car import CAR, FLOOR
from vtbook.experiments.rooms import ROOMS_EVALUATION
from vtbook.page import RECORD, Page
from vtlab.store import returns, weights
from vtlib.stats import Interval


@pytest.fixture(scope="module")
def page():
    return Page(ROOMS_EVALUATION, "rooms-evaluation")


def test_a_page_has_the_stored_runs_of_both_protocols_and_the_published_curves(page):
    stored = returns(ROOMS_EVALUATION.published, "GVT")
    assert page.runs["GVT"].identical(stored)
    assert page.text["GVT"].identical(returns(ROOMS_EVALUATION.equations, "GVT"))
    assert page["GVT"].share(5_000).centre * page["GVT"].scale == pytest.approx(
        stored.learning.sel(iteration=5_000).values.mean()
    )
    assert page.runs is page.runs
    assert set(page.printed) == {"learning", "greedy"}
    assert set(page.printed["greedy"]) == {"NT", "GVT", "1-MGVT", "3-MGVT"}
    np.testing.assert_array_equal(page.weights, weights(ROOMS_EVALUATION.published.pool))
    count = page.experiment.sources
    saved = cost(page.sources, count, page.runs["GVT"], page.runs["NT"]).saved
    assert page.cost("GVT").saved == saved


def test_on_mountain_car_nothing_is_never_to_arrive_and_costs_are_beside_ddqn():
    cars = Page(CAR)
    assert (cars["GVT"].floor, Page(ROOMS_EVALUATION)["GVT"].floor) == (FLOOR, 0)
    beside = cars.runs["GVT"], cars.runs["DDQN"], FLOOR
    assert cars.cost("GVT").saved == cost(cars.sources, cars.experiment.sources, *beside).saved


@pytest.mark.parametrize(
    ("value", "form", "text"),
    [(-0.251, "z.1f", "−0.3"), (Interval(0.5, 0.25, 1), ".0%", "50% (25% to 100%)")],
)
def test_a_number_goes_to_the_text_as_the_book_finds_it_there(page, monkeypatch, value, form, text):
    shown = Mock()
    monkeypatch.setattr(module, "display", shown)
    page.say("name", value, form)
    shown.assert_called_once_with(
        {f"{RECORD}text/plain": f"'{text}'", "text/plain": f"name: {text}"},
        raw=True,
        metadata={"scrapbook": {"name": "name", "mime_prefix": RECORD}},
    )


def test_settings_are_told_with_what_the_results_took(page):
    html = page.settings().data
    assert "lambda_" in html
    for label in page.experiment.algorithms:
        assert f"rooms-evaluation/{label}" in html.replace("<span class='whole'>", "")
