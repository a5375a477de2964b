"""The built book: complete, linked and numbered."""

import re
from functools import cache
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from bs4 import BeautifulSoup

import vtlib


def written_pages(book: Path) -> list[Path]:
    return sorted((book / "book").glob("*.html"))


@cache
def soup(path: Path) -> BeautifulSoup:
    return BeautifulSoup(path.read_text(encoding="utf-8"), "html.parser")


@cache
def identifiers(path: Path) -> set[str]:
    """Every target that a fragment can name on a page; none on one that is not there."""
    return {tag["id"] for tag in soup(path).find_all(id=True)} | {""} if path.exists() else set()


def test_the_book_builds(build_faults):
    if build_faults:
        pytest.fail("the book has warnings or failing pages:\n" + "\n".join(build_faults), False)


def test_internal_links_resolve(book):
    broken = []
    for path in (file for file in book.rglob("*.html") if "_static" not in file.parts):
        for tag in soup(path).select("[href], [src], [data]"):
            for reference in {"href", "src", "data"} & tag.attrs.keys():
                parts = urlsplit(tag[reference])
                if parts.scheme or parts.netloc:
                    continue
                target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
                target = target / "index.html" if target.is_dir() else target
                known = target.suffix != ".html" or unquote(parts.fragment) in identifiers(target)
                if not (target.exists() and known):
                    broken.append(f"{path.relative_to(book)} -> {tag[reference]}")
    assert not broken, "\n".join(broken)


def test_equations_carry_the_numbers_of_the_thesis_in_its_order(book):
    equations = [
        (equation["id"], equation.select_one(".eqno").text.strip("()#¶\uf0c1 "))
        for path in written_pages(book)
        for equation in soup(path).select("div.math[id^=equation-eq-]")
        if re.fullmatch(r"equation-eq-\d-\d+", equation["id"])
    ]
    labels = [f"2-{i}" for i in range(1, 24)] + [f"5-{i}" for i in range(1, 16)]
    assert equations == [(f"equation-eq-{x}", x.replace("-", ".")) for x in labels]


def test_the_reference_has_all_that_the_library_offers(book):
    documented = identifiers(book / "book" / "api.html")
    offered = {f"{getattr(vtlib, name).__module__}.{name}" for name in vtlib.__all__}
    assert offered <= documented
