"""The two protocols differ in what they say they differ in, and share all random numbers."""

import attrs
import numpy as np
import pytest
from attrs import evolve

from vtbook.experiments import rooms
from vtbook.experiments.cartpole import CARTPOLE
from vtlab.run import chosen_sources, targets
from vtlib.transfer import Settings

NAMES = ("EVALUATION", "CHANGE", "EXPLORATION", "LIKELIHOOD", "SOURCES")
ALL = [*(getattr(rooms, f"ROOMS_{name}") for name in NAMES), CARTPOLE]
# Variants of the rooms' evaluation, and what each has of its own beside algorithms.
VARIANTS = [
    (rooms.ROOMS_INGREDIENTS, set()),
    (rooms.ROOMS_DEVIATIONS, set()),
    (rooms.ROOMS_FRONTIER, {"family"}),
    (rooms.ROOMS_RETRAINED, {"pool"}),
    (rooms.ROOMS_CORNER, {"pool"}),
    (rooms.ROOMS_CALIBRATION, {"every", "probes", "probe"}),
]
TWO_AT_ONCE = {  # one alone cannot be changed, or was changed before
    "GVT, from the prior, no clip": {"init", "kl_clip"},
    "GVT, no clip at all": {"clip", "kl_clip"},
}


def changed(a, b):
    """Fields in which two configurations of one class differ."""
    assert type(a) is type(b)
    return {x.name for x in attrs.fields(type(a)) if getattr(a, x.name) != getattr(b, x.name)}


@pytest.mark.parametrize("protocols", ALL, ids=lambda x: x.published.name)
def test_protocols_share_streams_and_differ_in_the_method_alone(protocols):
    published, equations = protocols
    assert equations.name == f"{published.name}-equations"
    # the published likelihoods are of doors half a unit apart, one fewer than were drawn
    own = {"runs"} if protocols is rooms.ROOMS_LIKELIHOOD else set()
    allowed = {"name", "pool", "family", "algorithms", "each", "counts"} | own
    assert changed(published, equations) <= allowed
    assert (published.each, equations.each) == (True, False)
    of_pool = "settings" if protocols is CARTPOLE else "family"
    assert changed(published.pool, equations.pool) == {"name", of_pool}
    if not own:
        runs = range(published.runs)
        drawn = [(chosen_sources(e, runs), e.family.values(targets(e, runs))) for e in protocols]
        np.testing.assert_equal(*drawn)
    for label, one in equations.algorithms.items():
        assert isinstance(one, Settings) or one == published.algorithms[label], label


@pytest.mark.parametrize("protocols", ALL[:-1], ids=lambda x: x.published.name)
def test_the_rooms_have_the_settings_of_their_evaluation_and_stop_by_the_equations(protocols):
    for first, e, stops in zip(rooms.ROOMS_EVALUATION, protocols, (False, True), strict=True):
        for label, one in e.algorithms.items():
            if isinstance(one, Settings):
                known = first.algorithms["GVT" if label.startswith("GVT") else "1-MGVT"]
                assert evolve(one, components=1) == known
        assert e.pool.settings == first.pool.settings == first.algorithms["NT"]
        assert e.family.stops == e.pool.family.stops == stops


@pytest.mark.parametrize(("experiment", "own"), VARIANTS, ids=lambda x: getattr(x, "name", ""))
def test_variants_have_a_twin_in_the_figure_they_explain(experiment, own):
    (figure, equations), runs = rooms.ROOMS_EVALUATION, range(experiment.runs)
    assert changed(experiment, figure) == {"name", "algorithms", "iterations"} | own
    assert targets(experiment, runs).doors.equal(targets(figure, runs).doors)
    assert (chosen_sources(experiment, runs) == chosen_sources(figure, runs)).all()
    for label, algorithm in experiment.algorithms.items():
        name, _, change = label.partition(", ")
        twin = equations if change == "equations" else figure
        found = changed(algorithm, twin.algorithms[name])
        assert len(found) == (change not in ("", "equations")) or found == TWO_AT_ONCE[label], label
