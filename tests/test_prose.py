"""Lengths and numbers of runs that pages type out in their captions are those that ran."""

import re
from pathlib import Path

import pytest

from vtbook.experiments import cartpole, maze, mountain_car, rooms

BOOK = Path(__file__).resolve().parent.parent / "book"
WORDS = {1: "one", 5: "five", 8: "eight", 10: "ten", 12: "twelve", 20: "twenty", 50: "fifty"}
# A page's runs, and those of its sliders.
PAGES = {
    "cartpole": (cartpole.CARTPOLE, cartpole.CARTPOLE_SLIDERS),
    "mountain_car": (mountain_car.CAR, mountain_car.CAR_SLIDERS),
    "mazes": (maze.MAZE_TARGETS[maze.MAIN], maze.MAZE_SLIDERS),
    "rooms_evaluation": (rooms.ROOMS_EVALUATION, rooms.ROOMS_EVALUATION_SLIDERS),
    "rooms_distribution_change": (rooms.ROOMS_CHANGE, rooms.ROOMS_CHANGE_SLIDERS),
    "rooms_exploration": (rooms.ROOMS_EXPLORATION, rooms.ROOMS_EXPLORATION_SLIDERS),
    "rooms_number_of_sources": (rooms.ROOMS_SOURCES, rooms.ROOMS_SOURCES_SLIDERS),
}


@pytest.mark.parametrize("page", PAGES)
def test_curves_and_sliders_are_said_to_be_as_long_as_they_are(page):
    figure, moved = PAGES[page]
    text = " ".join((BOOK / f"{page}.md").read_text(encoding="utf-8").split())
    assert f"shows {WORDS[moved.runs]} runs of {moved.iterations:,} iterations" in text
    found = set(re.findall(r"(?:against|over) ([\d,]+) iterations", text))
    assert found <= {f"{figure.published.iterations:,}"}
    assert found or page == "rooms_number_of_sources"  # where the axis is another
