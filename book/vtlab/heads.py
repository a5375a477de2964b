"""Heads of stored runs: their first iterations, computed anew, leave the stored fingerprints."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from vtlab import run, sources, store
from vtlab.experiment import TASKS, Experiment, Pool
from vtlab.run import by_kernels
from vtlab.whole import (
    ABSOLUTE,
    RELATIVE,
    Whole,
    check_runs,
    compare_runs,
    members_of,
    units_with,
)

# Learning is chaotic: on a processor of another kind rounding sends one run in a hundred elsewhere
# within these iterations, but none in the first. A fault sends most of them elsewhere.
LOOKED_AT = 10
PARTED = 0.3
ROUNDED = 1 + 2**-20  # sources times this lead elsewhere where any rounding does


def verify_heads(
    *experiments: Experiment, root: Path | None = None
) -> Iterator[tuple[Pool | Experiment, str, Whole]]:
    """Compute the heads of every stored result behind experiments anew."""
    for owner, label in store.results_behind(experiments):
        yield owner, label, check_heads(owner, label, root)


def check_heads(
    owner: Pool | Experiment,
    label: str,
    root: Path | None = None,
    members: Sequence[int] | None = None,
) -> Whole:
    """As ``whole.check_runs``, but of the first iterations; tasks have none and are compared whole.

    Rounding parts a few among many, and runs that it parts here, too. Where more differ whole runs
    have to earn what the stored ones do; where most of them differ, they are wrong.
    """
    if label == TASKS:
        return check_runs(owner, label, members, root)
    chosen = members_of(owner, members)
    found = _compared(owner, label, chosen, root)
    if not found.parted:
        return found
    others = [m for m in members_of(owner) if m not in chosen][: max(0, LOOKED_AT - len(chosen))]
    beside = _compared(owner, label, others, root) if others else Whole([], {}, {})
    differing = {*found.wrong, *found.parted, *beside.wrong, *beside.parted}
    if len(differing) > PARTED * len(chosen + others):
        differing -= _sensitive(owner, label, [*found.parted, *beside.parted], root)
    share = len(differing) / len(chosen + others)
    if share <= 2 * PARTED:
        return found if share <= PARTED else check_runs(owner, label, members, root)
    many = f"{len(differing)} of {len(chosen + others)} heads differ"
    return Whole(found.alike, {}, found.wrong | dict.fromkeys(found.parted, many))


def _compared(owner: Pool | Experiment, label: str, members: list[int], root: Path | None) -> Whole:
    arrays, note = store.stored(owner, label, root)
    kept = {key: array for key, array in arrays.items() if key == "fingerprints"}

    def compared(some: Sequence[int]) -> Whole:
        if isinstance(owner, Pool):
            computed = sources.head(owner, some)
        else:
            computed = run.head(owner, label, some, store.weights(owner.pool, root))
        return compare_runs(owner, label, (kept, note), {"fingerprints": computed}, some)

    found = compared(members)
    if found.wrong and isinstance(owner, Experiment) and not by_kernels(owner, label):
        # torch rounds alike only in the batch in which a run was stored
        for unit in units_with(owner, label, list(found.wrong)):
            for member in found.wrong.keys() & compared(unit.members).alike:
                found.alike.append(member)
                del found.wrong[member]
    return found._replace(alike=sorted(found.alike))


def _sensitive(
    owner: Pool | Experiment, label: str, members: list[int], root: Path | None
) -> set[int]:
    """Runs that go elsewhere on this processor, too, if their sources change by a rounding."""
    if isinstance(owner, Pool):
        return set()
    given = store.weights(owner.pool, root)
    here, beside = (run.head(owner, label, members, given * by) for by in (1, ROUNDED))
    alike = np.isclose(here, beside, RELATIVE, ABSOLUTE).all((1, 2))
    return {member for member, same in zip(members, alike, strict=True) if not same}


def live_check(experiment: Experiment, label: str, run: int, root: Path | None = None) -> str:
    """Recompute the head of one stored run and say whether it has the stored fingerprints."""
    found = check_heads(experiment, label, root, [run])
    outcome = f"{'does NOT have' if found.wrong else 'has'} the stored fingerprints"
    if found.parted:
        outcome += " until rounding, which is not this processor's, sends it elsewhere"
    return f"Run {run} of {label}, computed anew just now, {outcome}."
