"""What publishes the book: the PDF, the citation, the workflow, and the book run elsewhere."""

from __future__ import annotations

import importlib.metadata
import json
import os
import re
from pathlib import Path

import pytest
from packaging.requirements import Requirement

yaml = pytest.importorskip("yaml")
ROOT = Path(__file__).resolve().parents[1]


def read(name: str):
    return yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))


def test_the_pdf_has_every_page_in_the_order_of_the_contents(extension):
    pytest.importorskip("playwright")
    pytest.importorskip("pypdf")
    named = [name for name, _ in extension("pdf").in_order(read("_toc.yml"))]
    written = re.findall(r"(?:root|file): (\S+)", (ROOT / "_toc.yml").read_text(encoding="utf-8"))
    assert named == written
    assert {Path(name).name for name in named} == {page.stem for page in ROOT.glob("book/*.md")}


def test_a_printed_page_shows_no_code_bars(book: Path, page) -> None:
    bars = page.locator("details.hide, div.cell_input:has(> details.hide)")
    page.goto((book / "book" / "background.html").as_uri(), wait_until="load")
    assert bars.evaluate_all("all => all.some(one => one.checkVisibility())")
    page.emulate_media(media="print")
    assert not bars.evaluate_all("all => all.some(one => one.checkVisibility())")


def test_the_citation_file_has_what_its_schema_requires():
    citation = read("CITATION.cff")
    assert citation["cff-version"] == "1.2.0"
    for key in ("message", "title", "version", "license"):
        assert isinstance(citation[key], str), key
        assert citation[key], key
    assert citation["type"] in ("software", "dataset")
    works = [citation, *citation["references"]]
    for work in works:
        assert work["title"]
        for author in work["authors"]:
            assert author.keys() == {"name"} or {"given-names", "family-names"} <= author.keys()
    assert re.search(
        rf'^version = "{citation["version"]}"$', (ROOT / "pyproject.toml").read_text(), re.M
    )


def test_the_workflow_runs_what_continuous_integration_runs():
    steps = read(".github/workflows/book.yml")["jobs"]["build"]["steps"]
    assert [step["run"] for step in steps if "run" in step].count(".ci/run") == 1
    uses = re.findall(r"uses: (\S+)", (ROOT / ".github/workflows/book.yml").read_text())
    assert all(re.fullmatch(r"actions/[a-z-]+@v\d+", one) for one in uses), uses


def test_the_book_runs_elsewhere_with_the_locked_versions():
    build = ROOT / "binder" / "postBuild"
    assert os.access(build, os.X_OK)
    assert "--require-hashes -r requirements.txt" in build.read_text()
    target = json.loads((ROOT / ".devcontainer" / "devcontainer.json").read_text())
    made = target["postCreateCommand"].removeprefix("make ")
    assert f"KERNELS := {made}" in (ROOT / "Makefile").read_text()


def test_the_lock_names_every_extra_that_an_installed_package_asks_for():
    # Else pip 23 takes the newest `coverage[toml]`, of which the lock has no digest.
    locked = {
        one.name: one.extras
        for line in (ROOT / "requirements.txt").read_text().splitlines()
        if "==" in line and not line.startswith((" ", "#"))
        for one in [Requirement(line.removesuffix(" \\"))]
    }
    asked = [
        one
        for installed in importlib.metadata.distributions()
        for one in map(Requirement, installed.requires or ())
        if one.extras and (one.marker is None or one.marker.evaluate({"extra": ""}))
    ]
    assert asked
    assert not [str(one) for one in asked if not one.extras <= locked.get(one.name, set())]
