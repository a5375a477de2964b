"""What publishes the book: the PDF, the citation, and the locked versions."""

import importlib.metadata
import re
from pathlib import Path

import pytest
from packaging.requirements import Requirement

yaml = pytest.importorskip("yaml")
ROOT = Path(__file__).resolve().parents[1]


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_a_printed_page_shows_no_code_bars_and_figures_of_lines(visit, page, extension):
    pytest.importorskip("pypdf")
    bars = page.locator("details.hide, div.cell_input:has(> details.hide)")
    visit("book/rooms_evaluation.html")
    page.evaluate(extension("pdf").PREPARED)
    assert page.locator("figure img[src$='.svg']").count() >= 2
    for media, shown in (("screen", True), ("print", False)):
        page.emulate_media(media=media)
        assert bars.evaluate_all("all => all.some(one => one.checkVisibility())") == shown


def test_the_citation_file_and_the_book_name_the_same_title_and_version():
    citation = yaml.safe_load(text("CITATION.cff"))
    assert f'\nversion = "{citation["version"]}"\n' in text("pyproject.toml")
    for key in ("title", "version"):
        assert f"{{{citation[key]}}}" in text("book/index.md")


def test_the_locks_name_every_extra_that_an_installed_package_asks_for():
    # Else pip 23 takes the newest `coverage[toml]`, of which a lock has no digest.
    locked = {
        requirement.name: requirement.extras
        for lock in ("requirements.txt", "requirements-checks.txt")
        for line in re.findall(r"^[^\s#].*==.*$", text(lock), re.MULTILINE)
        for requirement in [Requirement(line.removesuffix(" \\"))]
    }
    needed = [
        requirement
        for installed in importlib.metadata.distributions()
        for requirement in map(Requirement, installed.requires or ())
        if requirement.extras and requirement.name != "vtlib"  # which is installed in place
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""})
    ]
    assert needed
    assert not [str(x) for x in needed if not x.extras <= locked.get(x.name, set())]
