"""Tables as HTML: claims with their verdicts, how a figure was computed, and robust numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

import attrs
import numpy as np
from xarray import Dataset

from vtlib.claims import Claim, Runs
from vtlib.experiments.experiment import Experiment
from vtlib.plots import power_of_ten
from vtlib.rng import generator
from vtlib.stats import Interval, bootstrap_interval, improvement_interval, mean_interval

NO_BREAK = "\N{NO-BREAK SPACE}"
Row = Sequence[str]


def html_table(head: Row, rows: Iterable[Row]) -> str:
    """A plain HTML table of text, which is escaped."""

    def line(cells: Row, tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(c)}</{tag}>" for c in cells) + "</tr>"

    body = "".join(line(row, "td") for row in rows)
    return f"<table><thead>{line(head, 'th')}</thead><tbody>{body}</tbody></table>"


def claims_table(claims: Sequence[Claim]) -> str:
    """Claims with their verdicts and numbers."""
    return _claims("Claim", (_claim_row(one, escape(one.text)) for one in claims))


def scorecard_table(pages: Mapping[str, tuple[str, Sequence[Claim]]]) -> str:
    """Claims with their tests, verdicts and numbers below a link to each page.

    pages: {name of the page: (its title, its claims)}.
    """
    rows = []
    for page, (title, claims) in pages.items():
        link = f"<a href='{escape(page)}.html#the-claims'>{escape(title)}</a>"
        rows.append(f"<tr><th colspan='3'>{link}</th></tr>")
        for one in claims:
            words = f"{escape(one.text)}<br><small>{escape(one.test)}</small>"
            rows.append(_claim_row(one, words))
    return _claims("Claim and test", rows)


def _claims(first: str, rows: Iterable[str]) -> str:
    head = f"<tr><th>{first}</th><th>Verdict</th><th>Numbers</th></tr>"
    return f"<table class='claims'><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table>"


def _claim_row(claim: Claim, words: str) -> str:
    # The first word of the verdict is a class, by which the book colours its cell.
    return (
        f"<tr><td>{words}</td><td class='verdict {claim.verdict.split()[0]}'>"
        f"{escape(claim.verdict)}</td><td>{escape(claim.evidence)}</td></tr>"
    )


def settings_table(experiment: Experiment) -> str:
    """Every parameter of every algorithm of an experiment, from the configuration it ran with."""
    groups: dict[Any, list[str]] = {}
    for label, algorithm in experiment.algorithms.items():
        groups.setdefault(algorithm, []).append(label)
    settings = [attrs.asdict(algorithm) for algorithm in groups]
    names = dict.fromkeys(name for one in settings for name in one)
    rows = [[name, *(_text(one.get(name)) for one in settings)] for name in names]
    return html_table(["parameter", *map(_span, groups.values())], rows)


def _span(labels: Sequence[str]) -> str:
    return labels[0] if len(labels) == 1 else f"{labels[0]} to {labels[-1]}"


def _text(value: object) -> str:
    return "" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def cost_table(notes: Iterable[Mapping[str, Any]]) -> str:
    """Seconds, machine and versions of stored results, from the provenance of each.

    Algorithms of one owner with equal parameters share a row.
    """
    of_label = {(note["owner"], note["label"]): note for note in notes}
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for (owner, label), note in of_label.items():
        algorithm = note["config"].get("algorithm", label)
        groups.setdefault(f"{owner} {algorithm}", []).append(note)
    rows = [
        [
            f"{group[0]['owner']}/{_span([note['label'] for note in group])}",
            f"{sum(note['seconds'] for note in group):.0f}",
            group[0]["machine"]["processor"],
            "torch {torch}, numpy {numpy}".format(**group[0]["machine"]),
        ]
        for group in groups.values()
    ]
    return html_table(["stored result", "seconds of one core", "processor", "versions"], rows)


def robust_table(
    experiment: Experiment, runs: Mapping[str, Dataset], iteration: int, against: str
) -> str:
    """Shares of the optimum at an iteration: mean, interquartile mean, chance of improvement.

    runs: {label: stored returns}, against one of the labels. Intervals are Student's for the mean,
    and otherwise from a bootstrap within tasks that is seeded by the label.
    """
    shares = {x: Runs(x, stored).shares(iteration) for x, stored in runs.items()}
    each, rows = experiment.runs_per_task, []
    strata = np.arange(len(shares[against])) // each if each > 1 else None
    for label, share in shares.items():
        rng = generator(experiment.name, 0, f"bootstrap {label} {iteration}")
        middle = bootstrap_interval(share, rng, strata=strata)
        better = improvement_interval(share, shares[against], rng, strata)
        chance = "" if label == against else _interval(better)
        rows.append([label, _interval(mean_interval(share)), _interval(middle), chance])
    share_of = "mean share of the optimum", "interquartile mean"
    return html_table(["algorithm", *share_of, f"P(better than {against})"], rows)


def _interval(value: Interval) -> str:
    return f"{value.centre:.2f} ({value.low:.2f} to {value.high:.2f})"


def sweep_table(shares: Mapping[tuple[float, float], np.ndarray]) -> str:
    """Mean share of the optimum with half the width of its 95 % interval: ψ down, λ across.

    shares: {(lambda, psi): share (R,) of the optimum}, for each of some lambdas and psis.
    """
    lambdas, psis = (sorted({key[i] for key in shares}) for i in (0, 1))
    head = ["", *(f"λ{NO_BREAK}={NO_BREAK}{power_of_ten(x)}" for x in lambdas)]
    rows = [
        [f"ψ{NO_BREAK}={NO_BREAK}{psi:g}", *(_share(shares[x, psi]) for x in lambdas)]
        for psi in psis
    ]
    return html_table(head, rows)


def _share(values: np.ndarray) -> str:
    band = mean_interval(values)
    return f"{band.centre:.2f}{NO_BREAK}±{NO_BREAK}{band.high - band.centre:.2f}"
