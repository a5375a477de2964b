"""Heads of stored runs: their first iterations, computed anew, leave the stored fingerprints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vtlib.checks import check_whole
from vtlib.experiments import run, sources, store
from vtlib.experiments.experiment import TASKS, Experiment, Pool
from vtlib.experiments.whole import ABSOLUTE, RELATIVE, computed_elsewhere, count_of

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


def check_heads(
    owner: Pool | Experiment,
    label: str,
    root: Path | None = None,
    members: Sequence[int] | None = None,
) -> Heads:
    """Recompute the heads of a stored result's members, all of them unless some are named.

    Where the processor is of another kind than the stored result's, heads that share the first
    fingerprint are taken for rounding, if they are few among many. Raises as ``store.load`` does.
    """
    arrays, note = store.stored(owner, label, root)
    count = count_of(owner)
    chosen = list(range(count) if members is None else members)
    for member in chosen:
        check_whole("member", member, 0, count - 1)
    if isinstance(owner, Experiment) and label == TASKS:
        return Heads(_other_tasks(owner, arrays, chosen), [])
    prints = arrays.get("fingerprints", np.zeros(0))
    if prints.shape[:1] != (count,) or prints.dtype.kind != "f":
        path = store.path_of(owner, label, root)
        raise store.TornResult(f"{path} does not hold {count} fingerprints")
    early, late = _differing(owner, label, root, chosen, prints)
    if not late or not computed_elsewhere(note, store.machine()):
        return Heads(sorted(early + late), [])
    others = [m for m in range(count) if m not in chosen][: max(0, LOOKED_AT - len(chosen))]
    among_others = _differing(owner, label, root, others, prints)
    if len(early + late) + sum(map(len, among_others)) > PARTED * len(chosen + others):
        return Heads(sorted(early + late), [])
    return Heads(early, late)


def _differing(
    owner: Pool | Experiment,
    label: str,
    root: Path | None,
    members: Sequence[int],
    prints: np.ndarray,
) -> tuple[list[int], list[int]]:
    """The members whose heads differ in the first fingerprint, and those that do so later."""
    if not members:
        return [], []
    if isinstance(owner, Pool):
        computed = sources.head(owner, members)
    else:
        computed = run.head(owner, label, members, store.weights(owner.pool, root))
    if computed.shape[1:] != prints.shape[1:]:
        return list(members), []
    alike = np.isclose(computed, prints[members], RELATIVE, ABSOLUTE).all(2)
    early = [m for m, same in zip(members, alike[:, 0], strict=True) if not same]
    late = [m for m, same in zip(members, alike.all(1), strict=True) if not same]
    return early, [m for m in late if m not in early]


def _other_tasks(experiment: Experiment, arrays: store.Arrays, runs: Sequence[int]) -> list[int]:
    """The runs whose target, sources or optimum are not what is stored."""
    none, computed = np.zeros(0), run.task_table(experiment)

    def same(key: str, one: int) -> bool:
        kept, values = arrays.get(key, none), computed[key]
        alike = (kept.shape, kept.dtype.kind) == (values.shape, values.dtype.kind)
        return alike and np.allclose(kept[one], values[one], RELATIVE, ABSOLUTE)

    return [one for one in runs if not all(same(key, one) for key in computed)]


def live_check(experiment: Experiment, label: str, run: int, root: Path | None = None) -> str:
    """Recompute the head of one stored run and say whether it has the stored fingerprints."""
    wrong, parted = check_heads(experiment, label, root, [run])
    outcome = f"{'does NOT have' if wrong else 'has'} the stored fingerprints"
    if parted:
        outcome += " until rounding, which is not this processor's, sends it elsewhere"
    return f"Run {run} of {label}, computed anew just now, {outcome}."
