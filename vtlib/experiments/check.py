"""Trust in stored runs: their heads computed anew, or all of them, in a folder of its own.

The first iterations of a run, computed anew, must leave the fingerprints that are stored.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import ceil
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from attrs import evolve, frozen

from vtlib.checks import check_whole
from vtlib.experiments import run, sources, store
from vtlib.experiments.experiment import SOURCES, TASKS, Experiment, Pool
from vtlib.experiments.schedule import complete
from vtlib.rng import generator
from vtlib.stats import same_distribution_p

# Two machines round differently; what any change of the method, the seeds or the tasks does to a
# fingerprint is larger by orders of magnitude.
RELATIVE = 1e-3
ABSOLUTE = 1e-3
# Learning is chaotic: on a processor of another kind rounding sends one run in a hundred elsewhere
# within these iterations, but none in the first. A fault sends most of them elsewhere.
LOOKED_AT = 10
PARTED = 0.3
LEVEL = 0.01  # how often a report may call runs different that are not, whatever it compares


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
    count = owner.count if isinstance(owner, Pool) else owner.runs
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
    if not late or not _computed_elsewhere(note):
        return Heads(sorted(early + late), [])
    others = [m for m in range(count) if m not in chosen][: max(0, LOOKED_AT - len(chosen))]
    among_others = _differing(owner, label, root, others, prints)
    if len(early + late) + sum(map(len, among_others)) > PARTED * len(chosen + others):
        return Heads(sorted(early + late), [])
    return Heads(early, late)


def _computed_elsewhere(note: store.Note) -> bool:
    machine = note.get("machine")
    processor = machine.get("processor") if isinstance(machine, dict) else None
    return processor is not None and processor != store.machine()["processor"]


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
        return alike and _close(kept[one], values[one])

    return [one for one in runs if not all(same(key, one) for key in computed)]


def _close(a: np.ndarray, b: np.ndarray) -> bool:
    return a.shape == b.shape and np.allclose(a, b, RELATIVE, ABSOLUTE)


def verify(*experiments: Experiment, root: Path | None = None) -> Iterator[tuple[str, Heads]]:
    """Recompute the heads of every stored result behind experiments, each once: name and heads."""
    results = {(o.name, label): (o, label) for e in experiments for o, label in store.results_of(e)}
    for owner, label in results.values():
        yield f"{owner.name}/{label}", check_heads(owner, label, root)


def live_check(experiment: Experiment, label: str, run: int, root: Path | None = None) -> str:
    """Recompute the head of one stored run and say whether it has the stored fingerprints."""
    wrong, parted = check_heads(experiment, label, root, [run])
    outcome = f"{'does NOT have' if wrong else 'has'} the stored fingerprints"
    if parted:
        outcome += " until rounding, which is not this processor's, sends it elsewhere"
    return f"Run {run} of {label}, computed anew just now, {outcome}."


@frozen
class Comparison:
    """How a result computed anew compares with the stored one; p of the test, if one was needed."""

    owner: str
    label: str
    seconds: float
    megabytes: int
    verdict: str
    p: float | None = None


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
    first = {e.name: e if runs is None else first_runs(e, runs) for e in experiments}
    complete(list(first.values()), fresh, **workers)
    pairs = {}
    for e in experiments:
        for (owner, label), (new, _) in zip(
            store.results_of(e), store.results_of(first[e.name]), strict=True
        ):
            pairs[owner.name, label] = (owner, new, label)
    return [compare(owner, new, label, root, fresh) for owner, new, label in pairs.values()]


def first_runs(experiment: Experiment, runs: int) -> Experiment:
    """The experiment with its first runs alone: all that tasks share which have one of them."""
    whole = ceil(runs / experiment.runs_per_task) * experiment.runs_per_task
    return evolve(experiment, runs=min(whole, experiment.runs))


def compare(
    owner: Pool | Experiment, new: Pool | Experiment, label: str, root: Path, fresh: Path
) -> Comparison:
    """A result stored under root against the one that ``new``, the first runs, left in fresh."""
    anew, note = store.stored(new, label, fresh)
    about = owner.name, label, note["seconds"], note.get("megabytes", 0)
    if not store.exists(store.path_of(owner, label, root)):
        return Comparison(*about, "nothing stored to compare with")
    old, _ = store.stored(owner, label, root)
    if isinstance(new, Experiment):
        # the recorded iterations are no run's
        old = {k: v if k == "iterations" else v[: new.runs] for k, v in old.items()}
    if store.same_arrays(old, anew):
        return Comparison(*about, "identical")
    if old.keys() == anew.keys() and all(_close(old[key], anew[key]) for key in old):
        return Comparison(*about, "equal up to rounding")
    if label == TASKS:
        return Comparison(*about, "other tasks", 0.0)  # nothing random is in them
    key = "greedy" if label == SOURCES else "learning"
    a, b = (np.asarray(x[key], dtype=np.float64).reshape(len(x[key]), -1) for x in (old, anew))
    p = same_distribution_p(a.mean(1), b.mean(1), generator(owner.name, 0, "comparison"))
    return Comparison(*about, f"{key} returns {a.mean():.4f} stored, {b.mean():.4f} anew", p)


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
            test = "" if c.p is None else f", permutation test p = {c.p:.4f}: {outcome}"
            lines.append(f"  {c.label}: {c.verdict}{test}")
    lines.append(
        f"{len(comparisons)} results compared, "
        + (f"{len(bad)} DIFFER" if bad else "none differs")
        + f" (Kolmogorov-Smirnov distance, runs exchanged in pairs, level {LEVEL} over all)"
    )
    return lines
