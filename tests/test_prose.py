"""Numbers of configurations that pages type out, in captions and in words, are those that ran."""

import re
from pathlib import Path

import pytest

from vtbook.experiments import cartpole, compared, maze, mountain_car, rooms
from vtlib.experiments.experiment import Experiment

BOOK = Path(__file__).resolve().parent.parent / "book"
WORDS = {1: "one", 5: "five", 8: "eight", 10: "ten", 12: "twelve", 20: "twenty", 50: "fifty"}
CART, CAR = cartpole.CARTPOLE.published, mountain_car.CAR.published
EVALUATION, CHANGE = rooms.ROOMS_EVALUATION.published, rooms.ROOMS_CHANGE.published
LIKELIHOOD, EXPLORATION = rooms.ROOMS_LIKELIHOOD.published, rooms.ROOMS_EXPLORATION.published
SOURCES = rooms.ROOMS_SOURCES.published
TIGHT = rooms.PUBLISHED_GVT.lambda_ / rooms.PUBLISHED_GVT.jitter
LOOSE = rooms.PUBLISHED_MGVT.lambda_ / rooms.PUBLISHED_MGVT.sigma_p2
# A page's runs, and those of its sliders.
PAGES = {
    "cartpole": (CART, cartpole.CARTPOLE_SLIDERS),
    "mountain_car": (CAR, mountain_car.CAR_SLIDERS),
    "mazes": (maze.MAZE_TARGETS[maze.MAIN].published, maze.MAZE_SLIDERS),
    "rooms_evaluation": (EVALUATION, rooms.ROOMS_EVALUATION_SLIDERS),
    "rooms_distribution_change": (CHANGE, rooms.ROOMS_CHANGE_SLIDERS),
    "rooms_exploration": (EXPLORATION, rooms.ROOMS_EXPLORATION_SLIDERS),
}


def sliders(one: Experiment) -> str:
    return f"Each picture shows {WORDS[one.runs]} runs of {one.iterations:,} iterations"


TYPED = [
    *((page, sliders(moved)) for page, (_, moved) in PAGES.items()),
    ("rooms_number_of_sources", sliders(rooms.ROOMS_SOURCES_SLIDERS)),
    ("cartpole", f"return at {CART.iterations:,} iterations"),
    ("mountain_car", f"over the {WORDS[CAR.runs]} targets"),
    ("rooms_evaluation", f"for these {WORDS[EVALUATION.runs]} tasks"),
    ("rooms_evaluation", f"The {WORDS[EVALUATION.pool.count]} sources were trained by mellow TD"),
    ("rooms_evaluation", f"uniform starts, for {EVALUATION.pool.iterations:,} iterations"),
    ("rooms_distribution_change", f"each with {WORDS[CHANGE.runs]} points"),
    ("rooms_distribution_change", f"$\\lambda = 10^{{-3}}$: a factor of {TIGHT:g}."),
    ("rooms_distribution_change", f"$\\lambda = 10^{{-6}}$: a factor of {LOOSE:g}."),
    ("rooms_likelihood", f"learned in {WORDS[LIKELIHOOD.runs_per_task]} runs with sources"),
    ("rooms_likelihood", f"all their {LIKELIHOOD.iterations:,} steps"),
    ("rooms_exploration", f"lasts only {EXPLORATION.iterations:,} iterations"),
    ("rooms_number_of_sources", f"and after {SOURCES.iterations:,}, below"),
    *(
        ("comparison", f"weights of {WORDS[one.experiment.sources]} solved sources")
        for one in compared.ENVIRONMENTS
    ),
    ("comparison", f"a row for each of {WORDS[len(compared.SPACES)]} algorithms"),
    ("comparison", f"in each row {WORDS[compared.BUDGET]} short strokes"),
]


def text_of(page: str) -> str:
    return " ".join((BOOK / f"{page}.md").read_text(encoding="utf-8").split())


@pytest.mark.parametrize(("page", "typed"), TYPED)
def test_what_a_page_types_is_what_ran(page, typed):
    assert typed in text_of(page)


@pytest.mark.parametrize("page", PAGES)
def test_curves_are_said_to_be_as_long_as_they_are(page):
    found = set(re.findall(r"(?:against|over) ([\d,]+) iterations", text_of(page)))
    assert found == {f"{PAGES[page][0].iterations:,}"}
