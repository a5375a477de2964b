"""Ceilings of the book: words and bytes of a page, intervals, numbers in a sentence."""

import copy
import functools
import re
from pathlib import Path

import pytest
from bs4 import BeautifulSoup, Tag

# Words of a page's prose.
WORDS = {
    "index": 360,
    "idea": 600,
    "introduction": 300,
    "background": 760,
    "setting": 480,
    "related": 800,
    "method": 1020,
    "experiments": 190,
    "rooms_evaluation": 560,
    "rooms_distribution_change": 295,
    "rooms_exploration": 315,
    "rooms_likelihood": 270,
    "rooms_number_of_sources": 185,
    "cartpole": 340,
    "mountain_car": 470,
    "mazes": 520,
    "prior_weight": 365,
    "calibration": 460,
    "controls": 900,
    "comparison": 330,
    "recommended": 690,
    "guide": 725,
    "conclusions": 415,
}
APPENDIX = "parameters", "scorecard", "deviations", "trust_in_full", "reproducing", "glossary"
APPENDIX_WORDS = 2800
BYTES = 900e3
INTERVALS = 20
NUMBERS = 2  # in a sentence, an interval not counted: it belongs to the number before it
# What stands on a page and is no prose.
ELSE = "figure, table, pre, details, .admonition, .cell, script, style, div.math, .page-note"
NUMBER = r"[−+-]?\d[\d,]*(?:\.\d+)?"
INTERVAL = re.compile(rf"\({NUMBER}%?(?:,| to) {NUMBER}%?[^()]*\)")
# Names, not numbers: of figures, sections, equations, algorithms and years, and "95% interval".
NAMES = re.compile(
    r"(?:Figure|Table|[Ss]ection|[Cc]hapter|Algorithm|[Mm]aze|Python) [\d.]+|\(\d\.\d+\)"
    r"|\b\d+-MGVT|\b(?:19|20)\d\d\b|\b\d\d% intervals?"
)


@functools.cache
def paragraphs(path: Path) -> list[Tag]:
    """The paragraphs and items of lists that a reader sees who unfolds nothing.

    Not prose are code and what it shows, figures with their captions, tables, displayed equations,
    and what stands in a box or unfolds: the answer, notes, solutions, evidence.
    """
    document = BeautifulSoup(path.read_text(encoding="utf-8"), "html.parser")
    article = document.select_one("article.bd-article")
    for other in article.select(ELSE):
        other.decompose()
    return [text for text in article.select("p, li") if not text.find(["p", "li"])]


def without(path: Path, names: str) -> list[str]:
    """The texts of the paragraphs of a page, in which what has such a name is an x."""
    texts = [copy.copy(text) for text in paragraphs(path)]
    for name in (name for text in texts for name in text.select(names)):
        name.string = "x"
    return [" ".join(text.text.split()) for text in texts]


def words(path: Path) -> int:
    """The words of a page's prose; a formula within a line is one."""
    texts = without(path, ".math, code")
    return sum(bool(re.search(r"\w", word)) for text in texts for word in text.split())


def sentences(path: Path) -> list[str]:
    """The sentences of a page's prose, without formulas, code, links and citations."""
    texts = without(path, ".math, code, a")
    return [part for text in texts for part in re.split(r"(?<=[.?!:;])\s+(?=[A-Z(])", text)]


def numbers(sentence: str) -> list[str]:
    """The numbers of a sentence; not those of an interval, which belongs to one of them."""
    return re.findall(rf"(?<![\w.]){NUMBER}", NAMES.sub("", INTERVAL.sub("", sentence)))


def test_what_is_a_number():
    text = "In Figure 6.3, 1-MGVT earns 91% (−3% to 5%, a 95% interval) at 1,000 steps, see (5.13)."
    assert numbers(text) == ["91", "1,000"]


def test_the_words_of_a_page_stay_below_its_ceiling(book):
    counts = {name: words(book / f"book/{name}.html") for name in [*WORDS, *APPENDIX]}
    over = {name: counts[name] for name in WORDS if counts[name] > WORDS[name]}
    assert not over
    assert sum(counts[name] for name in APPENDIX) <= APPENDIX_WORDS


def test_a_page_with_its_pictures_is_light(book):
    pages = {path: path.stat().st_size for path in (book / "book").glob("*.html")}
    assert not {path.stem: size for path, size in pages.items() if size > BYTES}


def test_intervals_are_rare_in_running_text(book):
    pages = [book / f"book/{name}.html" for name in [*WORDS, *APPENDIX]]
    found = [x for path in pages for text in paragraphs(path) for x in INTERVAL.findall(text.text)]
    assert len(found) <= INTERVALS, "\n".join(found)


@pytest.mark.parametrize("name", WORDS)
def test_a_sentence_has_few_numbers(book, name):
    parts = sentences(book / f"book/{name}.html")
    assert not [part for part in parts if len(numbers(part)) > NUMBERS]
