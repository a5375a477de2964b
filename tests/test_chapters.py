"""The pages' sources name every module, and only what exists."""

import pkgutil
import re
from pathlib import Path

import attrs

from vtlib.transfer import Settings

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
