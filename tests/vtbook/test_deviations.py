"""The deviations: their runs are paired with a figure's, and their page's rule for what counts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import attrs
import numpy as np
import pytest
import torch

from vtbook.experiments.rooms import (
    ROOMS_CORNER,
    ROOMS_DEVIATIONS,
    ROOMS_EVALUATION,
    ROOMS_FRONTIER,
    ROOMS_INGREDIENTS,
)
from vtlib.experiments.run import chosen_sources, targets
from vtlib.stats import Interval

Cells = Callable[[str], dict[str, Any]]
ROOMS = ROOMS_INGREDIENTS, ROOMS_DEVIATIONS, ROOMS_FRONTIER, ROOMS_CORNER
TWO_AT_ONCE = {  # one alone cannot be changed, or was changed before
    "GVT, from the prior, no clip": {"init", "kl_clip"},
    "GVT, no clip at all": {"clip", "kl_clip"},
}


@pytest.mark.parametrize("experiment", ROOMS, ids=lambda e: e.name)
def test_runs_have_a_twin_in_the_rooms_evaluation(experiment) -> None:
    first, runs = ROOMS_EVALUATION.published, range(experiment.runs)
    assert (experiment.stream, experiment.every) == (first.stream, first.every)
    assert torch.equal(targets(experiment, runs).doors, targets(first, runs).doors)
    assert (chosen_sources(experiment, runs) == chosen_sources(first, runs)).all()


@pytest.mark.parametrize("experiment", ROOMS, ids=lambda e: e.name)
def test_each_label_changes_one_choice(experiment) -> None:
    for label, algorithm in experiment.algorithms.items():
        name, _, change = label.partition(", ")
        base = attrs.asdict(ROOMS_EVALUATION.published.algorithms[name])
        changed = {k for k, value in attrs.asdict(algorithm).items() if value != base[k]}
        assert len(changed) == bool(change) or changed == TWO_AT_ONCE[label], label


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


def test_an_effect_is_the_other_choice_minus_the_first_at_the_iterations_of_both(
    cells_of: Cells,
) -> None:
    page = cells_of("deviations")
    (pair, over, end), *_ = page["effects"]["First weights of networks"]
    other, first = (page["returns"](*one) for one in (pair.other, pair.first))
    shared = len(other.iteration)
    assert shared < len(first.iteration)
    both = other.learning.values, first.learning.values[:, :shared]
    gain = (both[0] - both[1]) / first.optimum.values[:, None]
    np.testing.assert_allclose([over.centre, end.centre], [gain.mean(), gain[:, -1].mean()], 1e-5)


def test_all_runs_of_the_deviations_are_on_the_page(cells_of: Cells) -> None:
    compared = [pair for found in cells_of("deviations")["effects"].values() for pair, *_ in found]
    for experiment in ROOMS:
        shown = {label for p in compared for e, label in (p.other, p.first) if e is experiment}
        assert shown == set(experiment.algorithms)
    for pair in compared:
        (other, _), (first, _) = pair.other, pair.first
        assert (other.stream, other.runs, other.every) == (first.stream, first.runs, first.every)
