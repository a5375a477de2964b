"""Numbers of configurations that pages type out, in captions and in words, are those that ran."""

from __future__ import annotations

from pathlib import Path

import pytest

from vtbook.experiments.cartpole import CARTPOLE, CARTPOLE_SLIDERS
from vtbook.experiments.compared import BUDGET, ENVIRONMENTS, SPACES
from vtbook.experiments.maze import MAIN, MAZE_SLIDERS, MAZE_TARGETS
from vtbook.experiments.mountain_car import CAR, CAR_SLIDERS
from vtbook.experiments.rooms import (
    PUBLISHED_GVT,
    PUBLISHED_MGVT,
    ROOMS_CHANGE,
    ROOMS_CHANGE_SLIDERS,
    ROOMS_EVALUATION,
    ROOMS_EVALUATION_SLIDERS,
    ROOMS_EXPLORATION,
    ROOMS_EXPLORATION_SLIDERS,
    ROOMS_LIKELIHOOD,
    ROOMS_SOURCES,
    ROOMS_SOURCES_SLIDERS,
)
from vtlib.experiments.experiment import Experiment

BOOK = Path(__file__).resolve().parent.parent / "book"
WORDS = {1: "one", 5: "five", 8: "eight", 10: "ten", 12: "twelve", 20: "twenty", 50: "fifty"}
MAZE = MAZE_TARGETS[MAIN].published
EVALUATION, CHANGE = ROOMS_EVALUATION.published, ROOMS_CHANGE.published
TIGHT = PUBLISHED_GVT.lambda_ / PUBLISHED_GVT.jitter
LOOSE = PUBLISHED_MGVT.lambda_ / PUBLISHED_MGVT.sigma_p2
LIKELIHOOD, EXPLORATION = ROOMS_LIKELIHOOD.published, ROOMS_EXPLORATION.published


def sliders(experiment: Experiment) -> str:
    return (
        f"Each picture shows {WORDS[experiment.runs]} runs of {experiment.iterations:,} iterations"
    )


TYPED = [
    ("rooms_evaluation", sliders(ROOMS_EVALUATION_SLIDERS)),
    ("rooms_distribution_change", sliders(ROOMS_CHANGE_SLIDERS)),
    ("rooms_exploration", sliders(ROOMS_EXPLORATION_SLIDERS)),
    ("rooms_number_of_sources", sliders(ROOMS_SOURCES_SLIDERS)),
    ("mazes", sliders(MAZE_SLIDERS)),
    ("cartpole", sliders(CARTPOLE_SLIDERS)),
    ("cartpole", f"over {CARTPOLE.published.iterations:,} iterations"),
    ("cartpole", f"against {CARTPOLE.published.iterations:,} iterations"),
    ("cartpole", f"return at {CARTPOLE.published.iterations:,} iterations"),
    ("mountain_car", sliders(CAR_SLIDERS)),
    ("mountain_car", f"over {CAR.published.iterations:,} iterations"),
    ("mountain_car", f"over the {WORDS[CAR.published.runs]} targets"),
    ("rooms_evaluation", f"against {EVALUATION.iterations:,} iterations"),
    ("rooms_evaluation", f"for these {WORDS[EVALUATION.runs]} tasks"),
    (
        "rooms_evaluation",
        f"The {WORDS[EVALUATION.pool.count]} sources were trained by mellow TD from uniform "
        f"starts, for {EVALUATION.pool.iterations:,} iterations",
    ),
    ("rooms_distribution_change", f"against {CHANGE.iterations:,} iterations"),
    ("rooms_distribution_change", f"each with {WORDS[CHANGE.runs]} points"),
    ("rooms_distribution_change", f"$\\lambda = 10^{{-3}}$: a factor of {TIGHT:g}."),
    ("rooms_distribution_change", f"$\\lambda = 10^{{-6}}$: a factor of {LOOSE:g}."),
    ("rooms_likelihood", f"learned in {WORDS[LIKELIHOOD.runs_per_task]} runs with sources"),
    ("rooms_likelihood", f"all their {LIKELIHOOD.iterations:,} steps"),
    ("rooms_exploration", f"lasts only {EXPLORATION.iterations:,} iterations"),
    ("rooms_number_of_sources", f"and after {ROOMS_SOURCES.published.iterations:,}, below"),
    ("mazes", f"against {MAZE.iterations:,} iterations"),
    *(
        ("comparison", f"weights of {WORDS[one.experiment.sources]} solved sources")
        for one in ENVIRONMENTS
    ),
    ("comparison", f"a row for each of {WORDS[len(SPACES)]} algorithms"),
    ("comparison", f"in each row {WORDS[BUDGET]} short strokes"),
]


@pytest.mark.parametrize(("page", "typed"), TYPED)
def test_what_a_page_types_is_what_ran(page, typed):
    assert typed in " ".join((BOOK / f"{page}.md").read_text().split())
