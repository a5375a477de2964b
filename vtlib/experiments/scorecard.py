"""Every claim of the thesis' experiments on one page, with its test, its numbers and verdict."""

from __future__ import annotations

from collections import Counter
from html import escape

from vtlib import claims
from vtlib.claims import Claim
from vtlib.experiments import judged

# What a bound of the checks is, and why it is where it is.
THRESHOLDS = {
    f"optimal: {claims.NEAR_OPTIMAL:.0%} of the planned optimum": (
        "closer to it, a curve in a figure cannot be told from the dashed line"
    ),
    f"solved, or near the optimum: {claims.SOLVED:.0%} of it": "what each source has to pass",
    f"about half: at most {claims.ABOUT_HALF:.0%}": "a half, with room for reading off a curve",
    f"from the start: by {claims.EARLY:,} iterations": "five episodes at the least",
    "clearly: the 95% interval, paired by run, excludes zero": "the thesis' own level",
}


def every_claim() -> dict[str, list[Claim]]:
    """The claims of each page, in the book's order."""
    return {page: judge() for page, judge in judged.PAGES.items()}


def counts(found: dict[str, list[Claim]]) -> dict[str, int]:
    """How many claims have each verdict."""
    number = Counter(one.verdict for each in found.values() for one in each)
    return {name: number[name] for name in (claims.REPRODUCED, claims.PARTLY, claims.NOT)}


def table(found: dict[str, list[Claim]]) -> str:
    """All claims as an HTML table, by the pages that show their figures."""
    rows = "".join(_head(page) + "".join(map(_row, each)) for page, each in found.items())
    head = "<tr><th>Claim and test</th><th>Verdict</th><th>Numbers</th></tr>"
    return f"<table class='claims'><thead>{head}</thead><tbody>{rows}</tbody></table>"


def _head(page: str) -> str:
    figure = (judged.PAGES[page].__doc__ or "").rstrip(".")
    return f"<tr><th colspan='3'><a href='{page}.html#the-claims'>{escape(figure)}</a></th></tr>"


def _row(one: Claim) -> str:
    return (
        f"<tr><td>{escape(one.text)}<br><small>{escape(one.test)}</small></td>"
        f"<td class='verdict {one.verdict.split()[0]}'>{escape(one.verdict)}</td>"
        f"<td>{escape(one.evidence)}</td></tr>"
    )


def thresholds_table() -> str:
    """The bounds of the checks and their reasons, as HTML."""
    rows = "".join(
        f"<tr><td>{escape(bound)}</td><td>{escape(reason)}</td></tr>"
        for bound, reason in THRESHOLDS.items()
    )
    return (
        f"<table><thead><tr><th>Bound</th><th>Reason</th></tr></thead><tbody>{rows}</tbody></table>"
    )
