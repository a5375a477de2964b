"""Trust in stored runs: their first iterations, computed anew, must leave the same fingerprints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vtlib import sources, store
from vtlib.checks import check_whole
from vtlib.experiments import POOLS, named, work
from vtlib.experiments import runs as runs_of
from vtlib.experiments.work import load_result, pool_weights

# Two machines round differently; what any change of the method, the seeds or the tasks does to a
# fingerprint is larger by orders of magnitude.
RELATIVE = 1e-3
ABSOLUTE = 1e-3
# Learning is chaotic: on a processor of another kind rounding sends one run in a hundred elsewhere
# within these iterations, but none in the first. A fault sends most of them elsewhere.
LOOKED_AT = 10
PARTED = 0.3


class Heads(NamedTuple):
    """Members (runs or sources) whose recomputed head differs from the stored one.

    wrong: for a reason. parted: by rounding, and after the first fingerprint.
    """

    wrong: list[int]
    parted: list[int]


def check_heads(owner: str, label: str, root: Path, members: Sequence[int] | None = None) -> Heads:
    """Recompute the heads of a stored result's members, all of them unless some are named.

    Where the processor is of another kind than the stored result's, heads that share the first
    fingerprint are taken for rounding, if they are few among many. Raises as ``load_result`` does.
    """
    arrays, note = load_result(owner, label, root)
    if label == "tasks":
        return Heads(_task_mismatches(owner, arrays), [])
    count = POOLS[owner].count if owner in POOLS else named(owner).runs
    chosen = list(range(count) if members is None else members)
    for member in chosen:
        check_whole("member", member, 0, count - 1)
    stored = arrays.get("fingerprints", np.zeros(0))
    if stored.shape[:1] != (count,) or stored.dtype.kind != "f":
        raise store.TornResult(f"{root / owner / label} does not hold {count} fingerprints")
    early, late = _differing(owner, label, root, chosen, stored)
    if not late or not _computed_elsewhere(note):
        return Heads(sorted(early + late), [])
    others = [m for m in range(count) if m not in chosen][: max(0, LOOKED_AT - len(chosen))]
    among_others = _differing(owner, label, root, others, stored)
    if len(early + late) + sum(map(len, among_others)) > PARTED * len(chosen + others):
        return Heads(sorted(early + late), [])
    return Heads(early, late)


def _computed_elsewhere(note: store.Note) -> bool:
    machine = note.get("machine")
    processor = machine.get("processor") if isinstance(machine, dict) else None
    return processor is not None and processor != store.machine()["processor"]


def _differing(
    owner: str, label: str, root: Path, members: Sequence[int], stored: np.ndarray
) -> tuple[list[int], list[int]]:
    """The members whose heads differ in the first fingerprint, and those that do so later."""
    if not members:
        return [], []
    if owner in POOLS:
        computed = sources.head(POOLS[owner], members)
    else:
        experiment = named(owner)
        computed = runs_of.head(experiment, label, members, pool_weights(experiment.pool, root))
    if computed.shape[1:] != stored.shape[1:]:
        return list(members), []
    alike = np.isclose(computed, stored[members], RELATIVE, ABSOLUTE).all(2)
    early = [m for m, same in zip(members, alike[:, 0], strict=True) if not same]
    late = [m for m, same in zip(members, alike.all(1), strict=True) if not same]
    return early, [m for m in late if m not in early]


def _task_mismatches(owner: str, arrays: store.Arrays) -> list[int]:
    experiment = named(owner)
    runs = range(experiment.runs)
    computed = runs_of.task_table(experiment)
    for key, values in computed.items():
        stored = arrays.get(key, np.zeros(0))
        if (stored.shape, stored.dtype.kind) != (values.shape, values.dtype.kind):
            return list(runs)
    alike = [
        np.isclose(arrays[key], computed[key], RELATIVE, ABSOLUTE).reshape(len(runs), -1).all(1)
        for key in computed
    ]
    return [run for run in runs if not all(same[run] for same in alike)]


def results_of(name: str) -> list[tuple[str, str]]:
    """Every stored result behind an experiment, by the names of owner and label."""
    return [(owner.name, label) for owner, label in work.results_of(named(name))]
