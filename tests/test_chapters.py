"""The pages' sources: modules, symbols and their names, and the length of runs."""

import pkgutil
import re
from pathlib import Path

import attrs
import pytest

from vtbook.experiments import cartpole, maze, mountain_car, rooms
from vtlib.transfer import Settings

BOOK = Path(__file__).resolve().parents[1] / "book"
PAGES = {path.stem: path.read_text(encoding="utf-8") for path in BOOK.glob("*.md")}
NUMBERS = {1: "one", 5: "five", 8: "eight", 10: "ten", 12: "twelve", 20: "twenty", 50: "fifty"}
# A page's runs, and those of its sliders.
RUNS = {
    "cartpole": (cartpole.CARTPOLE, cartpole.CARTPOLE_SLIDERS),
    "mountain_car": (mountain_car.CAR, mountain_car.CAR_SLIDERS),
    "mazes": (maze.MAZE_TARGETS[maze.MAIN], maze.MAZE_SLIDERS),
    "rooms_evaluation": (rooms.ROOMS_EVALUATION, rooms.ROOMS_EVALUATION_SLIDERS),
    "rooms_distribution_change": (rooms.ROOMS_CHANGE, rooms.ROOMS_CHANGE_SLIDERS),
    "rooms_exploration": (rooms.ROOMS_EXPLORATION, rooms.ROOMS_EXPLORATION_SLIDERS),
    "rooms_number_of_sources": (rooms.ROOMS_SOURCES, rooms.ROOMS_SOURCES_SLIDERS),
}


def test_the_reference_has_every_module_once(extension):
    api = extension("api")
    listed = [
        name
        for page in PAGES
        if page.startswith("api_")
        for patterns in api.MODULES.findall(PAGES[page])
        for name in api.matching(patterns)
    ]
    assert sorted(listed) == [name for name in api.modules() if name != "vtlib"]


def test_every_symbol_has_a_meaning_and_a_name_that_exists():
    lines = re.findall(r"^\| (?!symbol|---).*", PAGES["glossary"], re.MULTILINE)
    rows = [re.split(r"(?<!\\)\|", line)[1:-1] for line in lines]
    assert all(meaning.strip() for _, meaning, _, _ in rows)
    names = {name for row in rows for name in re.findall(r"`(.*?)`", row[-1])}
    settings = {f"Settings.{field}" for field in attrs.fields_dict(Settings)}
    assert names & settings
    for name in names - settings:
        assert any(exists(f"{package}.{name}") for package in ("vtlib", "vtlab")), name


def exists(name: str) -> bool:
    """Whether a dotted name is that of a module or of what one defines."""
    try:
        return pkgutil.resolve_name(name) is not None
    except (ImportError, AttributeError):
        return False


@pytest.mark.parametrize("page", RUNS)
def test_curves_and_sliders_are_said_to_be_as_long_as_they_are(page):
    figure, moved = RUNS[page]
    text = " ".join(PAGES[page].split())
    assert f"shows {NUMBERS[moved.runs]} runs of {moved.iterations:,} iterations" in text
    found = set(re.findall(r"(?:against|over) ([\d,]+) iterations", text))
    assert found <= {f"{figure.published.iterations:,}"}
    assert found or page == "rooms_number_of_sources"  # where the axis is another
