"""The two protocols differ in what they say they differ in, and share all random numbers."""

from __future__ import annotations

import attrs
import numpy as np
import pytest
from attrs import evolve

from vtbook.experiments import rooms
from vtbook.experiments.cartpole import CARTPOLE
from vtbook.experiments.protocols import Protocols, as_published
from vtlib.experiments.run import chosen_sources, targets
from vtlib.transfer import Settings

ALL = [
    rooms.ROOMS_EVALUATION,
    rooms.ROOMS_CHANGE,
    rooms.ROOMS_EXPLORATION,
    rooms.ROOMS_LIKELIHOOD,
    rooms.ROOMS_SOURCES,
    CARTPOLE,
]
# What an algorithm has of its own in the published rooms, beside `as_published`.
ROOMS_OWN = "lambda_", "buffer"


def changed(a: object, b: object) -> set[str]:
    """Fields in which two configurations of one class differ."""
    assert type(a) is type(b)
    return {x.name for x in attrs.fields(type(a)) if getattr(a, x.name) != getattr(b, x.name)}


def test_as_published_is_what_the_published_code_runs_with():
    gaussian, mixture = Settings("gaussian", lambda_=0.5), Settings(components=3, lambda_=0.5)
    assert changed(as_published(gaussian), gaussian) == {"init", "ddof", "kl_clip"}
    assert changed(as_published(mixture), mixture) == {"init", "responsibilities", "kl"}
    found = as_published(gaussian)
    assert (found.init, found.ddof, found.kl_clip, found.kl) == ("span", 1, 100.0, "full")
    found = as_published(mixture)
    assert (found.init, found.responsibilities, found.kl) == ("mean", "equal", "diagonal")
    assert (found.kl_clip, found.ddof) == (None, 0)


@pytest.mark.parametrize("protocols", ALL, ids=lambda x: x.published.name)
def test_protocols_share_streams_and_differ_in_the_method_alone(protocols: Protocols):
    published, equations = protocols
    assert equations.name == f"{published.name}-equations"
    expected = {"name", "pool", "family", "algorithms", "each", "counts"}
    # the published likelihoods are of doors half a unit apart, one fewer than were drawn
    ladder = protocols is rooms.ROOMS_LIKELIHOOD
    assert changed(published, equations) <= expected | ({"runs"} if ladder else set())
    assert (published.each, equations.each) == (True, False)
    assert published.pool.stream == equations.pool.stream
    if not ladder:
        runs = range(published.runs)
        np.testing.assert_array_equal(
            chosen_sources(published, runs), chosen_sources(equations, runs)
        )
        for name, values in published.family.values(targets(published, runs)).items():
            np.testing.assert_array_equal(
                values, equations.family.values(targets(equations, runs))[name]
            )
    for label, algorithm in equations.algorithms.items():
        own = published.algorithms[label]
        if isinstance(algorithm, Settings):
            allowed = ROOMS_OWN if protocols in ALL[:5] else ()
            like = evolve(as_published(algorithm), **{x: getattr(own, x) for x in allowed})
            assert own == like, label
        else:
            assert own == algorithm, label


def test_the_frontier_stops_by_the_equations_for_targets_and_sources():
    for protocols in ALL[:5]:
        published, equations = protocols
        for owner in (published, published.pool):
            assert not owner.family.stops
        for owner in (equations, equations.pool):
            assert owner.family.stops


def test_the_rooms_run_with_the_numbers_of_the_published_code():
    algorithms = rooms.ROOMS_EVALUATION.published.algorithms
    assert (algorithms["GVT"].lambda_, algorithms["GVT"].buffer) == (1e-3, 50_000)
    assert (algorithms["1-MGVT"].lambda_, algorithms["1-MGVT"].buffer) == (1e-6, 50_000)


def test_ingredients_change_one_thing_at_a_time():
    for label, algorithm in rooms.ROOMS_INGREDIENTS.algorithms.items():
        base = rooms.PUBLISHED_GVT if label.startswith("GVT") else rooms.PUBLISHED_MGVT
        assert len(changed(algorithm, base)) == label.count(", "), label


def test_variants_have_a_twin_in_the_figure_they_explain():
    figure = rooms.ROOMS_EVALUATION.published
    for one in (rooms.ROOMS_INGREDIENTS, rooms.ROOMS_DEVIATIONS, rooms.ROOMS_CALIBRATION):
        assert changed(one, figure) <= {"name", "algorithms", "iterations", "every", "probes"}
    assert changed(rooms.ROOMS_FRONTIER, figure) == {
        "name", "pool", "family", "algorithms", "iterations"
    }  # fmt: skip
    assert changed(rooms.ROOMS_CORNER, figure) == {"name", "pool", "algorithms", "iterations"}
