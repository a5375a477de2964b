"""All claims on one page: a bar of their verdicts, and a line for each to filter and to open."""

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from vtbook import tables
from vtbook.browser_panel import panel
from vtbook.claims import NOT, REPRODUCED, STRONGER, UNDECIDED, VERDICTS, Claim
from vtbook.plots import BookFigure, look

COLOURS = {STRONGER: "#0072b2", REPRODUCED: "#009e73", UNDECIDED: "#e69f00", NOT: "#d55e00"}
FIRST = next(iter(tables.PROTOCOLS))  # the protocol whose verdict a line shows


def bar(pages: Mapping[str, Sequence[Claim]]) -> Figure:
    """How many facts of the thesis have each verdict, a bar for each protocol."""
    with look():
        figure = BookFigure(figsize=(7.6, 1.9), layout="constrained")
        ax = figure.subplots()
        for y, protocol in enumerate(tables.PROTOCOLS):
            left = 0
            for verdict, count in tables.tally(pages.values(), protocol).items():
                if count:
                    ax.barh(y, count, left=left, color=COLOURS[verdict], alpha=0.75, height=0.6)
                    words = f"{count} {verdict.replace(' ', chr(10), 1)}"
                    ax.text(left + count / 2, y, words, ha="center", va="center", fontsize=8.5)
                left += count
            ax.text(-0.4, y, tables.PROTOCOLS[protocol], ha="right", va="center")
        ax.invert_yaxis()
        ax.set_axis_off()
    return figure


def lines(pages: Mapping[str, Sequence[Claim]]) -> str:
    """HTML of the claims of pages: one line each, with its verdict as published.

    What decides about a claim, in both protocols, unfolds below it. Without scripts all claims are
    shown, and no filter.
    """
    each = [_line(page, claim) for page, claims in pages.items() for claim in claims]
    verdicts = [verdict for verdict in VERDICTS if any(f"'{verdict}'" in x for x in each)]
    return panel(
        "scorecard",
        {},
        verdicts="".join(f"<option>{verdict}</option>" for verdict in verdicts),
        pages="".join(f"<option value='{x}'>{_title(x)}</option>" for x in pages),
        count=len(each),
        claims="".join(each),
    )


def _title(page: str) -> str:
    return page.replace("_", " ").capitalize()


def _line(page: str, claim: Claim) -> str:
    verdict = claim.verdict(FIRST) if FIRST in claim.numbers else "not measured"
    link = f"<a href='{page}.html#the-claims'>{_title(page)}</a>"
    return (
        f"<details data-page='{page}' data-verdict='{verdict}'>"
        f"<summary><span class='claim'>{tables.escape(claim.text)}</span> "
        f"<span class='verdict {verdict.split()[0]}'>{verdict}</span></summary>"
        f"<p>{link}</p>{tables.claims_table([claim])}</details>"
    )
