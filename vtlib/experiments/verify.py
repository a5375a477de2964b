"""Trust in stored runs: their first iterations, computed anew, must leave the same fingerprints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vtlib import sources, store
from vtlib.experiments import POOLS, named, work
from vtlib.experiments import runs as runs_of
from vtlib.experiments.work import load_result, pool_weights

# Two machines round differently; what any change of the method, the seeds or the tasks does to a
# fingerprint is larger by orders of magnitude.
RELATIVE = 1e-3
ABSOLUTE = 1e-3


def mismatches(
    owner: str, label: str, root: Path, members: Sequence[int] | None = None
) -> list[int]:
    """Members (runs or sources) of a stored result whose recomputed head differs from it.

    All members unless some are named. Raises as ``load_result`` does.
    """
    arrays, _ = load_result(owner, label, root)
    if label == "tasks":
        return _task_mismatches(owner, arrays)
    chosen = list(range(len(arrays["fingerprints"])) if members is None else members)
    if owner in POOLS:
        computed = sources.head(POOLS[owner], chosen)
    else:
        experiment = named(owner)
        computed = runs_of.head(experiment, label, chosen, pool_weights(experiment.pool, root))
    alike = np.isclose(computed, arrays["fingerprints"][chosen], RELATIVE, ABSOLUTE)
    return [m for m, same in zip(chosen, alike.all((1, 2)), strict=True) if not same]


def _task_mismatches(owner: str, arrays: store.Arrays) -> list[int]:
    experiment = named(owner)
    runs = range(experiment.runs)
    computed = runs_of.task_table(experiment)
    alike = [
        np.isclose(arrays[key], computed[key], RELATIVE, ABSOLUTE).reshape(len(runs), -1).all(1)
        for key in computed
    ]
    return [run for run in runs if not all(same[run] for same in alike)]


def results_of(name: str) -> list[tuple[str, str]]:
    """Every stored result behind an experiment, by the names of owner and label."""
    return [(owner.name, label) for owner, label in work.results_of(named(name))]
