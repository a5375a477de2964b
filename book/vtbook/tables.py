"""Tables as HTML, counts of verdicts, and numbers for the text."""

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
