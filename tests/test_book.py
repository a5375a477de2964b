"""The built book: complete, linked, numbered, described in words, and light."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from urllib.parse import unquote, urldefrag, urlsplit

import pytest
from bs4 import BeautifulSoup

ROOT = Path(__file__).resolve().parents[1]


def pages(book: Path) -> list[Path]:
    """Pages written for readers, and those that Sphinx adds."""
    found = [path for path in book.rglob("*.html") if "_static" not in path.parts]
    assert found, f"no pages under {book}"
    return sorted(found)


def written_pages(book: Path) -> list[Path]:
    """Pages that have a source in book/."""
    return [path for path in pages(book) if path.parent != book]


@cache
def soup(path: Path) -> BeautifulSoup:
    """A parsed page."""
    return BeautifulSoup(path.read_text(encoding="utf-8"), "html.parser")


def references(document: BeautifulSoup) -> Iterator[str]:
    """Every address that a page links to or loads."""
    for tag in document.find_all(True):
        for attribute in ("href", "src", "data"):
            if isinstance(tag.get(attribute), str):
                yield tag[attribute]


@cache
def identifiers(path: Path) -> set[str]:
    """Every target that a fragment can name on a page."""
    return {tag["id"] for tag in soup(path).find_all(id=True)} | {""}


def test_the_book_builds(build_faults: list[str]) -> None:
    if build_faults:
        pytest.fail("the book has warnings or failing pages:\n" + "\n".join(build_faults), False)


def test_every_source_page_is_in_the_book(book: Path) -> None:
    sources = {path.stem for path in (ROOT / "book").glob("*.md")}
    assert {path.stem for path in written_pages(book)} >= sources


def test_internal_links_resolve(book: Path) -> None:
    broken = []
    for path in pages(book):
        for reference in references(soup(path)):
            parts = urlsplit(reference)
            if parts.scheme or parts.netloc:
                continue
            address, fragment = urldefrag(reference)
            file = unquote(urlsplit(address).path)
            target = (path.parent / file).resolve() if file else path
            if target.is_dir():
                target /= "index.html"
            if not target.exists():
                broken.append(f"{path.relative_to(book)} -> {reference}")
            elif (
                target.suffix == ".html"
                and fragment
                and unquote(fragment) not in identifiers(target)
            ):
                broken.append(f"{path.relative_to(book)} -> {reference} (no such target)")
    assert not broken, "\n".join(broken)


def test_pictures_have_alternative_text(book: Path) -> None:
    bare = [
        f"{path.relative_to(book)}: {str(image)[:120]}"
        for path in written_pages(book)
        for image in soup(path).find_all("img")
        if not image.get("alt", "").strip() or image["alt"].startswith(("../", "_images"))
    ]
    assert not bare, "pictures without alternative text:\n" + "\n".join(bare)


def test_title_language_and_favicon(book: Path) -> None:
    for path in written_pages(book):
        document = soup(path)
        assert "Variational Transfer of Value Functions" in document.title.text, path
        assert document.html["lang"] == "en", path
        icon = document.find("link", rel="icon")
        assert icon is not None, path
        assert (path.parent / icon["href"]).is_file(), path


def test_equations_carry_the_numbers_of_the_thesis(book: Path) -> None:
    found = {}
    for path in written_pages(book):
        for equation in soup(path).select("div.math[id^=equation-eq-]"):
            if re.fullmatch(r"equation-eq-\d-\d+", equation["id"]):
                found[equation["id"]] = equation.select_one(".eqno").text.strip("()#¶\uf0c1 ")
    labels = [f"2-{i}" for i in range(1, 24)] + [f"5-{i}" for i in range(1, 16)]
    assert found == {f"equation-eq-{x}": x.replace("-", ".") for x in labels}


def test_equations_and_functions_lead_to_each_other(book: Path) -> None:
    reference = {path.name: soup(path) for path in (book / "book").glob("api_*.html")}
    for page in ("background", "method"):
        lines = soup(book / "book" / f"{page}.html").select("p.in-code")
        assert lines
        for link in (link for line in lines for link in line.find_all("a")):
            file, _, name = link["href"].partition("#")
            entry = reference[file].find(id=name).parent
            assert entry.select(f"a[href*='{page}.html#equation-eq-']"), name
            assert entry.select("div.math"), f"{name} shows no formula"


def test_every_symbol_leads_to_where_it_is_introduced(book: Path) -> None:
    rows = soup(book / "book" / "glossary.html").select("table tbody tr")
    plain = {
        " ".join(place.stripped_strings)
        for place in (row.select("td")[2] for row in rows)
        if len(place.find_all("a")) != len(place.text.split(","))
    }
    assert not plain


def test_the_gallery_shows_every_figure(book: Path) -> None:
    drawn = {
        f"{path.name}#{figure['id']}"
        for path in written_pages(book)
        if path.name != "index.html"
        for figure in soup(path).select("figure[id]")
    }
    shown = [link["href"] for link in soup(book / "book" / "gallery.html").select(".gallery a")]
    assert len(shown) == len(set(shown))
    assert set(shown) == drawn


def test_pages_with_code_offer_a_notebook_and_say_how_long_they_take(book: Path) -> None:
    for path in written_pages(book):
        source = (ROOT / "book" / path.name).with_suffix(".md").read_text(encoding="utf-8")
        links = [a["href"] for a in soup(path).select("a[href$='.ipynb']")]
        assert bool(links) == ("\nkernelspec:" in source[:500]), path.name
        for link in links:
            assert json.loads((path.parent / link).read_text(encoding="utf-8"))["cells"]
        if links:
            note = soup(path).select_one(".page-note").text
            assert re.match(r"Takes (about a second|\d+ (seconds|minutes)) to run", note), path.name


def test_pages_stay_light(book: Path) -> None:
    heavy = {
        path.name: round(path.stat().st_size / 1e6, 1)
        for path in written_pages(book)
        if path.stat().st_size > 4e6
    }
    assert not heavy, f"pages over 4 MB: {heavy}"


def test_the_build_leaves_nothing_for_git(book: Path) -> None:
    inside = subprocess.run(["git", "rev-parse"], cwd=ROOT, capture_output=True, check=False)
    if inside.returncode:
        pytest.skip("a downloaded archive: there is no git that could take notice")
    for made in ("_build/html", "book/_static/vendor/fetched", ".venv"):
        done = subprocess.run(["git", "check-ignore", "-q", made], cwd=ROOT, check=False)
        assert done.returncode == 0, f"{made} is not ignored"
