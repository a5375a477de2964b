"""Stored results computed anew, and the one rule by which they are the same.

Every number is equal to rounding. Where the arithmetic may differ, as on another processor, runs
begin alike and are equal in distribution, because learning is chaotic: sooner or later rounding
decides what a run does. This guards against staleness and accident: a result of another seed,
configuration or version of the method, or a file that is not the one that was stored.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vtlab import run, sources, store
from vtlab.experiment import TASKS, Experiment, Pool
from vtlab.permutation import same_distribution_p
from vtlab.units import Unit, compute, joined, shared_by_all, units_with
from vtlib.rng import generator

# Two machines round differently, by less than this; a change of the method, the seeds or the tasks
# alters numbers by orders of magnitude more.
RELATIVE = ABSOLUTE = 1e-3
BEGINNING = 2  # fingerprints, of iterations 1 and 49; at the third, rounding has moved many runs
ARITHMETIC = "processor", "kernels", "torch", "numpy"  # what rounding depends on
EARNED = "learning", "greedy", "fresh"  # arrays of returns, of runs and of sources
# How often equal results are called different: hardly once among some 1,500.
LEVEL = 1e-4
DRAWS = 100_000  # exchanges, where 10,000 cannot tell whether a p value is below the level


class Verdict(NamedTuple):
    """Whether what was computed anew is the same as what is stored, and in what way."""

    same: bool
    said: str


def verify(
    *experiments: Experiment,
    root: Path | None = None,
    rng: np.random.Generator | None = None,
    quick: bool = False,
) -> Iterator[tuple[Pool | Experiment, str, Verdict]]:
    """Compute every stored result behind experiments anew: its heads, then its runs.

    These are all runs, or one of each result, which rng draws; quick leaves them out.
    """
    for owner, label in store.results_behind(experiments):
        verdict = check(owner, label, root=root, quick=True)
        if verdict.same and not quick and label != TASKS:
            members = None if rng is None else [int(rng.integers(count_of(owner)))]
            verdict = check(owner, label, members, root)
        yield owner, label, verdict


def check(
    owner: Pool | Experiment,
    label: str,
    members: Sequence[int] | None = None,
    root: Path | None = None,
    quick: bool = False,
) -> Verdict:
    """Compute members of a stored result anew, or all; quick: their heads, or the whole of tasks.

    Raises as ``store.stored`` does.
    """
    stored, note = store.stored(owner, label, root)
    rows = range(count_of(owner)) if members is None else sorted(set(members))
    heads = quick and label != TASKS
    arrays = _computed(owner, label, rows, root, heads)
    if heads:
        stored = {key: x for key, x in stored.items() if key == "fingerprints"}
    return compare(owner, stored, note, arrays, rows, store.machine())


def live_check(experiment: Experiment, label: str, run: int, root: Path | None = None) -> str:
    """Recompute the head of one stored run and say whether it has the stored fingerprints."""
    prints = store.stored(experiment, label, root)[0]["fingerprints"][[run], :BEGINNING]
    new = _computed(experiment, label, [run], root, heads=True)["fingerprints"]
    outcome = "has" if _near(prints, new[:, :BEGINNING]).all() else "does NOT have"
    return f"Run {run} of {label}, computed anew just now, {outcome} the stored fingerprints."


def compare(
    owner: Pool | Experiment,
    stored: store.Arrays,
    note: store.Note,
    new: store.Arrays,
    members: Sequence[int],
    machine: Mapping[str, str],
) -> Verdict:
    """A stored result beside arrays of some of its members that a machine has computed anew."""
    shared, rows = shared_by_all(new), list(members)
    if {x.shape[:1] for k, x in stored.items() if k not in shared} != {(count_of(owner),)}:
        return Verdict(False, f"DIFFERS: not all its arrays hold {count_of(owner)} rows")
    old = {k: x if k in shared else x[rows] for k, x in stored.items()}
    if {k: x.shape for k, x in old.items()} != {k: x.shape for k, x in new.items()}:
        return Verdict(False, "DIFFERS in the names or the shapes of its arrays")
    near = {k: _near(x, new[k]) for k, x in old.items()}
    near |= {k: near[k].min(keepdims=True) for k in shared}  # near for all runs, or for none
    equal = np.all(np.broadcast_arrays(*near.values()), 0)
    count = f"{equal.sum()} of {len(rows)} equal"
    if equal.all():
        return Verdict(True, count)
    exact = all(note["machine"].get(x) == machine.get(x) for x in ARITHMETIC)
    if exact or "fingerprints" not in new:
        wrong = [k for k, x in near.items() if not x.all()]
        runs = [rows[i] for i in np.flatnonzero(~equal)]
        return Verdict(False, f"DIFFERS in {', '.join(wrong)} of {runs}")
    if not _begin_alike(old["fingerprints"], new["fingerprints"]):
        return Verdict(False, f"DIFFERS from the first iterations on: {count}")
    if (p := _p_value(old, new, owner.name)) < LEVEL:
        return Verdict(False, f"DIFFERS in distribution: {count}, p = {p:.1g}")
    return Verdict(True, f"{count}, the others but for rounding")


def _near(old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Which rows of two arrays are equal, to rounding where they are of floats."""
    same = np.isclose(old, new, RELATIVE, ABSOLUTE) if old.dtype.kind == "f" else old == new
    rows: np.ndarray = same.reshape(len(same), -1).all(1)
    return rows


def _begin_alike(old: np.ndarray, new: np.ndarray) -> bool:
    """Whether all runs have the first fingerprint, and half of them the second.

    Rounding decides so early only in few runs, between actions of the same value.
    """
    near = [_near(old[:, i], new[:, i]) for i in range(min(BEGINNING, old.shape[1]))]
    return bool(near[0].all() and near[-1].sum() >= len(old) // 2)


def _p_value(old: store.Arrays, new: store.Arrays, name: str) -> float:
    """P value of the hypothesis that stored and new runs could be exchanged; 1 with one run.

    It compares mean returns of runs, while learning and of the greedy policy (Bonferroni).
    """
    values = [1.0]
    for key in sorted(new.keys() & EARNED):
        a, b = (np.asarray(x[key], float).reshape(len(x[key]), -1).mean(1) for x in (old, new))
        if len(a) > 1:
            p = same_distribution_p(a, b, generator(name, 0, "comparison"))
            if p < 0.01:
                p = same_distribution_p(a, b, generator(name, 1, "comparison"), DRAWS)
            values.append(2 * p)
    return min(values)


def _computed(
    owner: Pool | Experiment, label: str, members: Sequence[int], root: Path | None, heads: bool
) -> store.Arrays:
    """The arrays of members or their heads, as they are stored: from whole units."""
    weights = None if isinstance(owner, Pool) else store.weights(owner.pool, root)
    units = units_with(owner, label, members)
    arrays = joined([_head(x, weights) if heads else compute(x, weights)[0] for x in units])
    rows = np.flatnonzero(np.isin([member for unit in units for member in unit.members], members))
    shared = shared_by_all(arrays)
    return {key: array if key in shared else array[rows] for key, array in arrays.items()}


def _head(unit: Unit, weights: np.ndarray | None) -> store.Arrays:
    if isinstance(unit.owner, Pool):
        return {"fingerprints": sources.head(unit.owner, unit.members)}
    assert weights is not None
    return {"fingerprints": run.head(unit.owner, unit.label, unit.members, weights)}


def count_of(owner: Pool | Experiment) -> int:
    """How many members each result of an owner has."""
    return owner.count if isinstance(owner, Pool) else owner.runs
