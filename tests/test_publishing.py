"""What publishes the book: its citation."""

from pathlib import Path

import pytest

yaml = pytest.importorskip("yaml")
ROOT = Path(__file__).resolve().parents[1]


def test_the_citation_file_and_the_book_name_the_same_title_and_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert f'\nversion = "{citation["version"]}"\n' in (ROOT / "pyproject.toml").read_text()
    index = (ROOT / "book" / "index.md").read_text(encoding="utf-8")
    assert f"{{{citation['title']}}}" in index
    assert f"{{{citation['version']}}}" in index
