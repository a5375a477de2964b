"""How a figure was computed, as tables for the fold at the end of its page."""

from __future__ import annotations

from dataclasses import asdict
from html import escape

import numpy as np

from vtlib.experiments import named
from vtlib.experiments.experiment import Algorithm, Experiment
from vtlib.experiments.reading import provenance, returns
from vtlib.stats import Interval, bootstrap_interval, improvement_interval, mean_interval
from vtlib.streams import generator


def tables(name: str) -> str:
    """Parameters and cost of an experiment, as HTML."""
    return settings_table(name) + cost_table(name)


def settings_table(name: str) -> str:
    """Every parameter of every algorithm of an experiment, from the configuration it ran with."""
    groups = alike(named(name))
    settings = [asdict(algorithm) for algorithm in groups]
    rows = dict.fromkeys(key for one in settings for key in one)
    cells = [[key, *(_text(one.get(key)) for one in settings)] for key in rows]
    return html_table(["parameter", *map(_span, groups.values())], cells)


def cost_table(name: str) -> str:
    """Seconds, machine and versions of every stored result behind an experiment."""
    notes = {(note["owner"], note["label"]): note for note in provenance(name)}
    experiment = named(name)
    groups = [[(experiment.pool.name, "sources")], [(name, "tasks")]]
    groups += [[(name, label) for label in labels] for labels in alike(experiment).values()]
    rows = []
    for group in groups:
        first = notes[group[0]]
        rows.append(
            [
                f"{group[0][0]}/{_span([label for _, label in group])}",
                f"{sum(notes[key]['seconds'] for key in group):.0f}",
                first["machine"]["processor"],
                f"torch {first['machine']['torch']}, numpy {first['machine']['numpy']}",
            ]
        )
    return html_table(["stored result", "seconds of one core", "processor", "versions"], rows)


def alike(experiment: Experiment) -> dict[Algorithm, list[str]]:
    """Labels of an experiment by their parameters: those that differ in their sources together."""
    groups: dict[Algorithm, list[str]] = {}
    for label, algorithm in experiment.algorithms.items():
        groups.setdefault(algorithm, []).append(label)
    return groups


def _span(labels: list[str]) -> str:
    return labels[0] if len(labels) == 1 else f"{labels[0]} to {labels[-1]}"


def robust_table(name: str, labels: list[str], iteration: int, against: str) -> str:
    """Shares of the optimum at an iteration: mean, interquartile mean, chance of improvement.

    Intervals are Student's for the mean, and from a seeded bootstrap within tasks otherwise.
    """
    experiment = named(name)
    tasks = np.array([experiment.task_of(run) for run in range(experiment.runs)])
    strata = None if experiment.runs_per_task == 1 else tasks

    def share(label: str) -> np.ndarray:
        stored = returns(name, label)
        shares: np.ndarray = stored.at(iteration) / stored.optimum
        return shares

    rows = []
    for label in labels:
        rng = generator(name, 0, f"bootstrap {label} {iteration}")
        middle = bootstrap_interval(share(label), rng, strata=strata)
        better = improvement_interval(share(label), share(against), rng, strata)
        chance = "" if label == against else _interval(better)
        rows.append([label, _interval(mean_interval(share(label))), _interval(middle), chance])
    head = [
        "algorithm",
        "mean share of the optimum",
        "interquartile mean",
        f"P(better than {against})",
    ]
    return html_table(head, rows)


def _interval(value: Interval) -> str:
    return f"{value.centre:.2f} ({value.low:.2f} to {value.high:.2f})"


def html_table(head: list[str], rows: list[list[str]]) -> str:
    """A plain HTML table."""

    def line(cells: list[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(c)}</{tag}>" for c in cells) + "</tr>"

    body = "".join(line(row, "td") for row in rows)
    return f"<table><thead>{line(head, 'th')}</thead><tbody>{body}</tbody></table>"


def _text(value: object) -> str:
    if value is None:
        return ""
    return f"{value:g}" if isinstance(value, float) else str(value)
