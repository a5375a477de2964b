"""Everything from nothing, in a folder of its own, compared with what is stored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path

import numpy as np

from vtlib import store
from vtlib.experiments.experiment import Experiment
from vtlib.experiments.schedule import Workers, complete
from vtlib.experiments.verify import ABSOLUTE, RELATIVE
from vtlib.experiments.work import load, load_result, results_of
from vtlib.sources import Pool
from vtlib.stats import same_distribution_p
from vtlib.streams import generator

LEVEL = 0.01  # how often a report may call runs different that are not, whatever it compares


@dataclass(frozen=True)
class Comparison:
    """How a result computed anew compares with the stored one; p of the test, if one was needed."""

    owner: str
    label: str
    seconds: float
    megabytes: int
    verdict: str
    p: float | None = None


def first_runs(experiment: Experiment, runs: int) -> Experiment:
    """The experiment with its first runs alone: all that tasks share which have one of them."""
    whole = ceil(runs / experiment.runs_per_task) * experiment.runs_per_task
    return replace(experiment, runs=min(whole, experiment.runs))


def reproduce(
    experiments: Sequence[Experiment],
    root: Path,
    fresh: Path,
    workers: Workers,
    device: str = "cpu",
) -> list[Comparison]:
    """Compute the experiments under ``fresh``, resuming there, and compare with those under root.

    An experiment may have fewer runs than the stored one of its name: its first.
    """
    complete(experiments, fresh, workers, device=device)
    results = {(o.name, label): (o, label) for e in experiments for o, label in results_of(e)}
    return [_compare(owner, label, root, fresh) for owner, label in results.values()]


def _compare(owner: Pool | Experiment, label: str, root: Path, fresh: Path) -> Comparison:
    new, note = load(owner, label, fresh)
    about = owner.name, label, note["seconds"], note.get("megabytes", 0)
    if not store.exists(root / owner.name / label):
        return Comparison(*about, "nothing stored to compare with")
    old = load_result(owner.name, label, root)[0]
    if isinstance(owner, Experiment):
        # the recorded iterations are no run's
        old = {k: v if k == "iterations" else v[: owner.runs] for k, v in old.items()}
    if store.same_arrays(old, new):
        return Comparison(*about, "identical")
    if old.keys() == new.keys() and all(_close(old[key], new[key]) for key in old):
        return Comparison(*about, "equal up to rounding")
    if label == "tasks":
        return Comparison(*about, "other tasks", 0.0)  # nothing random is in them
    key = "greedy" if label == "sources" else "learning"
    a, b = (np.asarray(x[key], dtype=np.float64).reshape(len(x[key]), -1) for x in (old, new))
    p = same_distribution_p(a.mean(1), b.mean(1), generator(owner.name, 0, "comparison"))
    return Comparison(*about, f"{key} returns {a.mean():.4f} stored, {b.mean():.4f} anew", p)


def _close(a: np.ndarray, b: np.ndarray) -> bool:
    return a.shape == b.shape and np.allclose(a, b, RELATIVE, ABSOLUTE)


def differing(comparisons: Sequence[Comparison]) -> list[Comparison]:
    """Those whose test rejects that both sets of runs are alike (Bonferroni over all of them)."""
    return [c for c in comparisons if c.p is not None and c.p < LEVEL / len(comparisons)]


def report(comparisons: Sequence[Comparison]) -> list[str]:
    """Lines to print: each pool and experiment with what it took, then its results."""
    lines, bad = [], differing(comparisons)
    for owner in dict.fromkeys(c.owner for c in comparisons):
        mine = [c for c in comparisons if c.owner == owner]
        seconds, peak = sum(c.seconds for c in mine), max(c.megabytes for c in mine)
        lines.append(f"{owner}: {seconds:.0f} s of one core, {peak} MB at most in a process")
        for c in mine:
            outcome = "DIFFERENT" if c in bad else "equal in distribution"
            lines.append(
                f"  {c.label}: {c.verdict}"
                + ("" if c.p is None else f", permutation test p = {c.p:.4f}: {outcome}")
            )
    lines.append(
        f"{len(comparisons)} results compared, "
        + (f"{len(bad)} DIFFER" if bad else "none differs")
        + f" (Kolmogorov-Smirnov distance, runs exchanged in pairs, level {LEVEL} over all)"
    )
    return lines
