"""What publishes the book: the PDF and the citation."""

from pathlib import Path

import pytest

yaml = pytest.importorskip("yaml")
ROOT = Path(__file__).resolve().parents[1]


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
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert f'\nversion = "{citation["version"]}"\n' in (ROOT / "pyproject.toml").read_text()
    index = (ROOT / "book" / "index.md").read_text(encoding="utf-8")
    assert f"{{{citation['title']}}}" in index
    assert f"{{{citation['version']}}}" in index
