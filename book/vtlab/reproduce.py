"""Experiments computed again from nothing, in a folder of its own, beside what is stored."""

from collections.abc import Sequence
from math import ceil
from pathlib import Path
from typing import Any

from attrs import evolve, frozen

from vtlab import store
from vtlab.experiment import SOURCES, Experiment, Pool
from vtlab.schedule import complete
from vtlab.whole import EARNED, LEVEL, compare_runs, count_of, together


@frozen
class Comparison:
    """How a result computed anew compares with the stored one.

    different: for a reason that the verdict names. p: of the test of runs parted by rounding;
    lowest: the least that so few runs could have given.
    """

    owner: str
    label: str
    seconds: float
    megabytes: int
    verdict: str
    different: bool = False
    p: float | None = None
    lowest: float = 0.0


def reproduce(
    experiments: Sequence[Experiment],
    root: Path,
    fresh: Path,
    runs: int | None = None,
    **workers: Any,
) -> list[Comparison]:
    """Compute experiments under ``fresh``, resuming there, and compare with those under root.

    Only the first ``runs`` of each are computed, if so many are asked for. workers: as for
    ``schedule.complete``.
    """
    if fresh.resolve() == root.resolve():
        raise ValueError(f"results must be compared with others than themselves, got {fresh} twice")
    results = store.results_behind(experiments)
    for owner, label in results:
        if store.exists(path := store.path_of(owner, label, root)):
            store.check_note(path, store.read(path)[1], owner, label)
    first = {e.name: e if runs is None else first_runs(e, runs) for e in experiments}
    complete(list(first.values()), fresh, **workers)
    return [
        compare(owner, first.get(owner.name, owner), label, root, fresh) for owner, label in results
    ]


def first_runs(experiment: Experiment, runs: int) -> Experiment:
    """The experiment with its first runs alone: all that tasks share which have one of them."""
    whole = ceil(runs / experiment.runs_per_task) * experiment.runs_per_task
    return evolve(experiment, runs=min(whole, experiment.runs))


def compare(
    owner: Pool | Experiment, new: Pool | Experiment, label: str, root: Path, fresh: Path
) -> Comparison:
    """A result stored under root against the one that ``new``, the first runs, left in fresh.

    Run by run and number by number; those that rounding has parted, by their distribution.
    """
    anew, note = store.stored(new, label, fresh)
    about = owner.name, label, note["seconds"], note.get("megabytes", 0)
    if not store.exists(store.path_of(owner, label, root)):
        return Comparison(*about, "nothing stored to compare with")
    old, members = store.stored(owner, label, root), range(count_of(new))
    whole = compare_runs(owner, label, old, anew, members, note["machine"])
    if whole.wrong:
        first, what = next(iter(whole.wrong.items()))
        verdict = f"{len(whole.wrong)} of {len(members)} differ, number {first} first: {what}"
        return Comparison(*about, verdict, different=True)
    if not whole.parted:
        same = store.same_arrays({k: old[0][k][: len(anew[k])] for k in anew}, anew)
        return Comparison(*about, "identical" if same else "equal up to rounding")
    parted = list(whole.parted)
    keys = ("greedy",) if label == SOURCES else EARNED
    before, after = ({key: x[key][parted] for key in keys} for x in (old[0], anew))
    said, p, lowest = together(before, after, keys, f"{owner.name}/{label}")
    verdict = (
        f"{len(whole.alike)} of {len(members)} alike, the others up to iteration "
        f"{min(whole.parted.values()):,} or more, and then {said}"
    )
    return Comparison(*about, verdict, p=p, lowest=lowest)


def differing(comparisons: Sequence[Comparison]) -> list[Comparison]:
    """Those that differ for a reason, or whose test says so (Bonferroni over all of them)."""
    level = LEVEL / max(1, len(comparisons))
    return [c for c in comparisons if c.different or (c.p is not None and c.p < level)]


def report(comparisons: Sequence[Comparison]) -> list[str]:
    """Lines to print: each pool and experiment with what it took, then its results."""
    lines, bad = [], differing(comparisons)
    for owner in dict.fromkeys(c.owner for c in comparisons):
        mine = [c for c in comparisons if c.owner == owner]
        seconds, peak = sum(c.seconds for c in mine), max(c.megabytes for c in mine)
        lines.append(f"{owner}: {seconds:.0f} s of one core, {peak} MB at most in a process")
        lines += [f"  {c.label}: {_outcome(c, c in bad, len(comparisons))}" for c in mine]
    lines.append(
        f"{len(comparisons)} results compared, "
        + (f"{len(bad)} DIFFER" if bad else "none differs")
        + f" (runs parted by rounding: Kolmogorov-Smirnov distance, level {LEVEL} over all)"
    )
    return lines


def _outcome(c: Comparison, bad: bool, of: int) -> str:
    if c.p is None:
        return f"DIFFERENT: {c.verdict}" if bad else c.verdict
    if c.lowest > LEVEL / of:
        return f"{c.verdict}: too few runs to tell"
    outcome = "DIFFERENT" if bad else "equal in distribution"
    return f"{c.verdict}, permutation test p = {c.p:.4f}: {outcome}"
