"""The reference names every module."""

from pathlib import Path

BOOK = Path(__file__).resolve().parents[1] / "book"
PAGES = {path.stem: path.read_text(encoding="utf-8") for path in BOOK.glob("*.md")}


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
