"""What publishes the book: the PDF, the citation, and the book run elsewhere."""

import importlib.metadata
import re
from pathlib import Path

import pytest
from packaging.requirements import Requirement

yaml = pytest.importorskip("yaml")
ROOT = Path(__file__).resolve().parents[1]


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_every_page_is_in_the_table_of_contents_and_so_in_the_pdf():
    named = re.findall(r"(?:root|file): book/(\S+)", text("_toc.yml"))
    assert sorted(named) == sorted(page.stem for page in ROOT.glob("book/*.md"))


def test_a_printed_page_shows_no_code_bars_and_figures_of_lines(book, page, extension):
    pytest.importorskip("pypdf")
    bars = page.locator("details.hide, div.cell_input:has(> details.hide)")
    page.goto((book / "book" / "rooms_evaluation.html").as_uri(), wait_until="load")
    page.evaluate(extension("pdf").PREPARED)
    assert page.locator("figure img[src$='.svg']").count() >= 2
    for media, shown in (("screen", True), ("print", False)):
        page.emulate_media(media=media)
        assert bars.evaluate_all("all => all.some(one => one.checkVisibility())") == shown


def test_the_citation_file_has_what_its_schema_requires_and_the_book_says_the_same():
    citation = yaml.safe_load(text("CITATION.cff"))
    required = {"cff-version", "message", "title", "authors", "version", "license"}
    assert required <= {key for key, value in citation.items() if value}
    assert f'\nversion = "{citation["version"]}"\n' in text("pyproject.toml")
    for key in ("title", "version"):
        assert f"{{{citation[key]}}}" in text("book/index.md")


def test_the_locks_name_every_extra_that_an_installed_package_asks_for():
    # Else pip 23 takes the newest `coverage[toml]`, of which a lock has no digest.
    locked = {
        one.name: one.extras
        for lock in ("requirements.txt", "requirements-checks.txt")
        for line in re.findall(r"^[^\s#].*==.*$", text(lock), re.MULTILINE)
        for one in [Requirement(line.removesuffix(" \\"))]
    }
    asked = [
        one
        for installed in importlib.metadata.distributions()
        for one in map(Requirement, installed.requires or ())
        if one.extras and one.name != "vtlib"  # which is installed in place
        if one.marker is None or one.marker.evaluate({"extra": ""})
    ]
    assert asked
    assert not [str(one) for one in asked if not one.extras <= locked.get(one.name, set())]
