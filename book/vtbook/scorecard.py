"""All claims on one page: a bar of their verdicts, and a line for each to filter."""

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from vtbook import tables
from vtbook.browser_panel import panel
from vtbook.claims import NOT, REPRODUCED, STRONGER, UNDECIDED, VERDICTS, Claim
from vtbook.plots import BookFigure, look
from vtlab.stats import Interval

COLOURS = {STRONGER: "#0072b2", REPRODUCED: "#009e73", UNDECIDED: "#e69f00", NOT: "#d55e00"}


def bar(pages: Mapping[str, Sequence[Claim]]) -> Figure:
    """How many facts of the thesis have each verdict."""
    with look():
        figure = BookFigure(figsize=(7.6, 0.7))
        figure.set_layout_engine("none")
        ax, left = figure.add_axes((0, 0, 1, 1)), 0
        for verdict, count in tables.tally(pages.values()).items():
            if count:
                ax.barh(0, count, left=left, color=COLOURS[verdict], alpha=0.75, height=0.6)
                words = f"{count} {verdict.replace(' ', chr(10), 1)}"
                ax.text(left + count / 2, 0, words, ha="center", va="center", fontsize=8.5)
            left += count
        ax.set_axis_off()
    return figure


def lines(pages: Mapping[str, Sequence[Claim]]) -> str:
    """HTML of the claims of pages: one line each, which unfolds to its number.

    Without scripts all claims are shown, and no filter.
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
    """A claim with its verdict, and on click what decides about it."""
    numbers = f"{claim.measure}: {claim.bounds}. Our runs: {_decisive(claim, claim.number)}"
    if claim.overlap is not None:
        numbers += f", met at {claim.overlap:.0%}"
    if claim.printed is not None:
        numbers += f". Published curve: {_decisive(claim, claim.printed)}"
    whose = " (a claim of this book’s)" if claim.ours else ""
    return (
        f"<li data-page='{page}' data-verdict='{claim.verdict}'><details><summary>"
        f"{tables.escape(claim.text)}{whose} "
        f"<span class='verdict {claim.verdict.split()[0]}'>{claim.verdict}</span></summary>"
        f"<p>{tables.escape(numbers)}. <a href='{page}.html'>{_title(page)}</a></p></details></li>"
    )


def _decisive(claim: Claim, number: Interval) -> str:
    """A number with so many digits that its verdict follows from what is written."""
    verdict = claim.judge(number)
    for digits in (2, 3, 4):
        if claim.judge(Interval(*(round(float(x), digits) for x in number))) == verdict:
            break
    return tables.words(number, f"z.{digits}f")
