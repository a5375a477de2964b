"""What the stored runs took to compute, by experiment."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from vtlib import store
from vtlib.experiments import EXPERIMENTS
from vtlib.experiments.protocol import html_table
from vtlib.experiments.work import results_of
from vtlib.store import results_folder

CORES = 2


class Cost(NamedTuple):
    """Seconds of processor of an experiment's runs, and of the sources it is the first to need."""

    name: str
    runs: int
    iterations: int
    sources: float
    computed: float


def costs(root: Path | None = None) -> list[Cost]:
    """What each experiment took, in the book's order."""
    root = root or results_folder()
    seen: set[str] = set()
    found = []
    for experiment in EXPERIMENTS.values():
        seconds = [0.0, 0.0]
        for owner, label in results_of(experiment):
            if owner.name == experiment.name or owner.name not in seen:
                own = owner.name == experiment.name
                seconds[own] += store.provenance(root / owner.name / label)["seconds"]
        seen.add(experiment.pool.name)
        runs = experiment.runs * len(experiment.algorithms)
        found.append(Cost(experiment.name, runs, runs * experiment.iterations, *seconds))
    return found


def minutes(seconds: float) -> float:
    """Minutes of two cores in which so many seconds of processor pass."""
    return seconds / 60 / CORES


def table(found: list[Cost]) -> str:
    """The costs as HTML, in minutes of two cores."""
    head = ["Experiment", "Runs", "Iterations", "Sources", "Runs take", "Both"]
    rows = [
        [
            c.name,
            f"{c.runs:,}",
            f"{c.iterations / 1e6:.1f} million",
            _shown(c.sources) if c.sources else "as above",
            _shown(c.computed),
            _shown(c.sources + c.computed),
        ]
        for c in found
    ]
    return html_table(head, rows)


def _shown(seconds: float) -> str:
    return f"{minutes(seconds):.0f}\u00a0min"  # a space at which no line breaks
