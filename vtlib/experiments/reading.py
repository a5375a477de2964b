"""What the book's pages read: stored returns, optima, and the live check of one stored run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from vtlib.claims import Returns
from vtlib.experiments import named
from vtlib.experiments.verify import check_heads
from vtlib.experiments.work import load_result
from vtlib.store import results_folder


def optimum(name: str, root: Path | None = None) -> np.ndarray:
    """Planned optimum (R,) of an experiment's targets."""
    return load_result(name, "tasks", root or results_folder())[0]["optimum"]


def returns(name: str, label: str, root: Path | None = None) -> Returns:
    """Stored returns of one algorithm of an experiment."""
    root = root or results_folder()
    arrays, _ = load_result(name, label, root)
    best = optimum(name, root)[arrays["run"]]
    return Returns(arrays["iterations"], arrays["learning"], arrays["greedy"], best)


def provenance(name: str, root: Path | None = None) -> list[dict[str, Any]]:
    """Provenance of the pool, the tasks and every algorithm of an experiment."""
    root = root or results_folder()
    experiment = named(name)
    stored = [(experiment.pool.name, "sources"), (name, "tasks")]
    stored += [(name, label) for label in experiment.algorithms]
    return [load_result(owner, label, root)[1] for owner, label in stored]


def live_check(name: str, label: str, run: int, root: Path | None = None) -> str:
    """Recompute the head of one stored run and say whether it has the stored fingerprints."""
    wrong, parted = check_heads(name, label, root or results_folder(), [run])
    outcome = f"{'does NOT have' if wrong else 'has'} the stored fingerprints"
    if parted:
        outcome += " until rounding, which is not this processor's, sends it elsewhere"
    return f"Run {run} of {label}, computed anew just now, {outcome}."
