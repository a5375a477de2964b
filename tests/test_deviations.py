"""The deviations: their runs are paired with a figure's, and their page's rule for what counts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import attrs
import numpy as np
import pytest
import torch

from vtlib.experiments.rooms import (
    GVT,
    MGVT,
    ROOMS_CORNER,
    ROOMS_DEVIATIONS,
    ROOMS_EVALUATION,
)
from vtlib.experiments.run import chosen_sources, targets
from vtlib.stats import Interval

Cells = Callable[[str], dict[str, Any]]


@pytest.mark.parametrize("experiment", [ROOMS_DEVIATIONS, ROOMS_CORNER], ids=lambda e: e.name)
def test_runs_have_a_twin_in_the_rooms_evaluation(experiment) -> None:
    runs = range(experiment.runs)
    assert (experiment.stream, experiment.every) == (
        ROOMS_EVALUATION.stream,
        ROOMS_EVALUATION.every,
    )
    assert torch.equal(targets(experiment, runs).doors, targets(ROOMS_EVALUATION, runs).doors)
    assert (chosen_sources(experiment, runs) == chosen_sources(ROOMS_EVALUATION, runs)).all()
    for label, algorithm in experiment.algorithms.items():
        base = attrs.asdict(GVT if label.startswith("GVT") else MGVT)
        changed = {k for k, value in attrs.asdict(algorithm).items() if value != base[k]}
        assert len(changed - {"init"}) == (experiment is ROOMS_DEVIATIONS), label


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0.04, 0.08, "higher"),
        (-0.2, -0.1, "lower"),
        (0.01, 0.04, "no effect"),
        (0.0, 0.0, "no effect"),
        (-0.04, 0.04, "no effect"),
        (-0.01, 0.3, "undecided"),
        (0.01, 0.06, "undecided"),
        (-0.06, 0.04, "undecided"),
    ],
)
def test_an_effect_counts_from_its_bound_on(cells_of: Cells, low, high, expected) -> None:
    page = cells_of("deviations")
    assert page["outcome"](Interval((low + high) / 2, low, high)) == expected


def test_an_effect_is_the_other_choice_minus_ours_at_the_iterations_of_both(
    cells_of: Cells,
) -> None:
    page = cells_of("deviations")
    (pair, over, end), *_ = page["effects"]["First weights of networks"]
    other, here = (page["returns"](*one) for one in (pair.other, pair.here))
    shared = len(other.iteration)
    assert shared < len(here.iteration)
    gain = (other.learning.values - here.learning.values[:, :shared]) / here.optimum.values[:, None]
    np.testing.assert_allclose([over.centre, end.centre], [gain.mean(), gain[:, -1].mean()], 1e-5)


def test_all_runs_of_the_deviations_are_on_the_page(cells_of: Cells) -> None:
    effects = cells_of("deviations")["effects"]
    compared = [pair for found in effects.values() for pair, *_ in found]
    shown = {label for e, label in (p.other for p in compared) if e is ROOMS_DEVIATIONS}
    assert shown == set(ROOMS_DEVIATIONS.algorithms)
    for pair in compared:
        (other, _), (here, _) = pair.other, pair.here
        assert (other.stream, other.runs, other.every) == (here.stream, here.runs, here.every)
        seen_before = other not in (ROOMS_DEVIATIONS, ROOMS_CORNER)
        assert (pair.expected == "") == seen_before
