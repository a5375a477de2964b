"""Tables as HTML: claims with their verdicts, and numbers for the text."""

import html
from collections.abc import Iterable, Sequence

import numpy as np

from vtbook.claims import VERDICTS, Claim
from vtlab.stats import Interval

Row = Sequence[str]


def escape(text: str) -> str:
    """Text for HTML, with printers' apostrophes."""
    return html.escape(text).replace("&#x27;", "’")


def html_table(head: Row, rows: Iterable[Row], caption: str = "") -> str:
    """A plain HTML table of text, which is escaped; the first cell of each row names it."""
    above = f"<caption>{escape(caption)}</caption>" if caption else ""
    heads = "".join(f"<th scope='col'>{escape(x)}</th>" for x in head)
    body = ""
    for name, *cells in rows:
        values = "".join(f"<td>{escape(cell)}</td>" for cell in cells)
        body += f"<tr><th scope='row'>{escape(name)}</th>{values}</tr>"
    return f"<table>{above}<thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>"


def heat_table(head: Row, rows: Iterable[Row], behind: np.ndarray, caption: str) -> str:
    """A table of numbers as text, the bluer the nearer one is to the best of its like.

    behind (rows, columns): by how much of a scale it is behind; below 3% a number is printed bold.
    What was not run is not a number.
    """
    table = html_table(head, rows, caption).replace("<table>", "<table class='heat'>")
    for share in behind.flat:
        look = "text-align: center"
        if not np.isnan(share):  # in the cell's own style, which a notebook keeps, too
            look += f"; background: rgb(0 114 178 / {max(0.5 - share, 0):.0%})"
            look += "; font-weight: bold" * bool(share < 0.03)
        table = table.replace("<td>", f"<td style='{look}'>", 1)
    return table


OURS, PUBLISHED = "Our runs", "Published curve"
MET = (
    "<em>Met</em>: the share of iterations at which our interval meets the published one; "
    "the smallest such share where a claim compares several curves."
)


def claims_table(claims: Sequence[Claim]) -> str:
    """Claims with what decides about them: the number, its bounds, and the verdict."""
    printed = any(x.printed is not None for x in claims)
    heads = ["Claim, and the number that decides", OURS, *[PUBLISHED] * printed]
    head = "".join(f"<th scope='col'>{x}</th>" for x in heads)
    rows = "".join(_claim_row(x, printed) for x in claims)
    body = f"<thead><tr>{head}</tr></thead><tbody>{rows}</tbody>"
    caption = f"<caption>{MET}</caption>" if "<br>met at" in body else ""
    return f"<table class='claims'>{caption}{body}</table>"


def _claim_row(claim: Claim, printed: bool) -> str:
    ours = " <em>(a claim of this book’s)</em>" if claim.ours else ""
    decides = f"<small>{escape(claim.measure)}: {claim.bounds}</small>"
    number = escape(_decisive(claim, claim.number))
    if claim.overlap is not None:
        number += f"<br>met at {claim.overlap:.0%}"
    # The first word of the verdict is a class, by which the book colours its cell.
    cells = f"<td class='verdict {claim.verdict.split()[0]}'>{_on_phones(OURS)}{claim.verdict}"
    cells += f"<br><small>{number}</small></td>"
    if claim.printed is not None:
        number = _on_phones(PUBLISHED) + escape(_decisive(claim, claim.printed))
        cells += f"<td><small>{number}</small></td>"
    elif printed:
        cells += "<td></td>"
    return f"<tr><th scope='row'>{escape(claim.text)}{ours}<br>{decides}</th>{cells}</tr>"


def _decisive(claim: Claim, number: Interval) -> str:
    """A number with so many digits that its verdict follows from what is written."""
    verdict = claim.judge(number)
    for digits in (2, 3, 4):
        if claim.judge(Interval(*(round(float(x), digits) for x in number))) == verdict:
            break
    return words(number, f"z.{digits}f")


def _on_phones(head: str) -> str:
    """What a column is called, in each cell, where the table's head is not shown."""
    return f"<span class='head'>{head}: </span>"


def fact_verdicts(claims: Iterable[Claim]) -> list[str]:
    """The verdict on each fact of one page: the worst of its claims' verdicts."""
    verdicts: dict[str, list[str]] = {}
    for claim in claims:
        verdicts.setdefault(claim.fact, []).append(claim.verdict)
    return [max(rows, key=VERDICTS.index) for rows in verdicts.values()]


def tally(pages: Iterable[Sequence[Claim]]) -> dict[str, int]:
    """How many facts of the thesis' own have each verdict, by pages of claims."""
    verdicts = [x for claims in pages for x in fact_verdicts(x for x in claims if not x.ours)]
    return {verdict: verdicts.count(verdict) for verdict in VERDICTS}


def words(value: Interval | np.ndarray | float | str, form: str = "z.2f") -> str:
    """A number in words, with its interval if it has one, by a format for each; words by "s"."""
    if isinstance(value, tuple):
        if value.low == value.high:
            return words(value.centre, form)
        centre, low, high = (words(x, form) for x in value)
        return f"{centre} ({low} to {high})"
    text = f"{value:{form}}"
    return f"−{text[1:]}" if text.startswith("-") else text
