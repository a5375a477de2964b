"""Numbers of configurations that pages type out, in captions and in words, are those that ran."""

from __future__ import annotations

from pathlib import Path

import pytest

from vtlib.experiments.cartpole import (
    CARTPOLE,
    CARTPOLE_LATE,
    CARTPOLE_SLIDERS,
)
from vtlib.experiments.experiment import Experiment
from vtlib.experiments.maze import CORNERS, MAZE_TARGETS, MAZES
from vtlib.experiments.mountain_car import CAR, CAR_SLIDERS
from vtlib.experiments.rooms import (
    ROOMS_CHANGE,
    ROOMS_CHANGE_SLIDERS,
    ROOMS_EVALUATION,
    ROOMS_LIKELIHOOD,
    ROOMS_LIKELIHOOD_SLIDERS,
    ROOMS_SLIDERS,
)

BOOK = Path(__file__).resolve().parent.parent / "book"
WORDS = {1: "one", 5: "five", 10: "ten", 20: "twenty", 50: "fifty"}
MAZE = MAZE_TARGETS["north-east"]
NT = ROOMS_EVALUATION.algorithms["NT"]


def sliders(experiment: Experiment) -> str:
    return (
        f"Each picture shows {WORDS[experiment.runs]} runs of {experiment.iterations:,} iterations"
    )


TYPED = [
    ("cartpole", sliders(CARTPOLE_SLIDERS)),
    ("cartpole", f"over {CARTPOLE.published.iterations:,} iterations"),
    ("cartpole", f"against {CARTPOLE.published.iterations:,} iterations"),
    ("cartpole", f"return at {CARTPOLE.published.iterations:,} iterations"),
    ("stability", f"The first {WORDS[CARTPOLE_LATE.runs]} runs by the equations were computed"),
    ("stability", f"means over {WORDS[CARTPOLE_LATE.runs]} runs and 95%"),
    ("stability", f"{WORDS[2 * CARTPOLE_LATE.runs]} lines of steps"),
    ("mountain_car", sliders(CAR_SLIDERS)),
    ("mountain_car", f"over {CAR.published.iterations:,} iterations"),
    ("mountain_car", f"over the {WORDS[CAR.published.runs]} targets"),
    ("rooms_evaluation", sliders(ROOMS_SLIDERS)),
    ("rooms_evaluation", f"against {ROOMS_EVALUATION.iterations:,} iterations"),
    ("rooms_evaluation", f"for these {WORDS[ROOMS_EVALUATION.runs]} tasks"),
    (
        "rooms_evaluation",
        f"The {WORDS[ROOMS_EVALUATION.pool.count]} sources were trained by mellow TD from uniform "
        f"starts, for {ROOMS_EVALUATION.pool.iterations:,} iterations",
    ),
    (
        "rooms_evaluation",
        f"over the first {NT.epsilon_steps:,} of the {ROOMS_EVALUATION.iterations:,} iterations",
    ),
    ("rooms_distribution_change", sliders(ROOMS_CHANGE_SLIDERS)),
    ("rooms_distribution_change", f"against {ROOMS_CHANGE.iterations:,} iterations"),
    ("rooms_distribution_change", f"each with {WORDS[ROOMS_CHANGE.runs]} points"),
    (
        "rooms_likelihood",
        f"shows {WORDS[ROOMS_LIKELIHOOD_SLIDERS.runs_per_task]} run of each of the "
        f"{WORDS[ROOMS_LIKELIHOOD_SLIDERS.runs]} tasks, for "
        f"{ROOMS_LIKELIHOOD_SLIDERS.iterations:,} iterations",
    ),
    ("rooms_likelihood", f"learned in {WORDS[ROOMS_LIKELIHOOD.runs_per_task]} runs with sources"),
    (
        "mazes",
        f"The {WORDS[MAZES.count]} mazes, {WORDS[MAZES.count // len(CORNERS)]} for each corner",
    ),
    ("mazes", f"Each of {WORDS[MAZE.runs]} runs"),
    ("mazes", f"against {MAZE.iterations:,} iterations"),
    ("mazes", f"over {MAZE.iterations:,} iterations"),
    ("conclusions", f"averaged over {CAR.iterations:,} iterations"),
    ("conclusions", f"over {MAZE.iterations:,} iterations"),
]


@pytest.mark.parametrize(("page", "typed"), TYPED)
def test_what_a_page_types_is_what_ran(page, typed):
    assert typed in " ".join((BOOK / f"{page}.md").read_text().split())
