"""Experiments computed again from nothing, in a folder of its own, beside what is stored."""

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from math import ceil
from pathlib import Path

from attrs import evolve

from vtlab import store
from vtlab.experiment import Experiment, Pool
from vtlab.schedule import complete
from vtlab.verify import Verdict, compare, count_of


def reproduce(
    experiments: Sequence[Experiment],
    root: Path,
    fresh: Path,
    runs: int | None = None,
    executor: Executor | None = None,
) -> Iterator[tuple[Pool | Experiment, str, Verdict]]:
    """Compute experiments under ``fresh``, resuming there, and compare with those under root.

    Only the first ``runs`` of each are computed, unless that is None; the rest is as for
    ``schedule.complete``.
    """
    if fresh.resolve() == root.resolve():
        raise ValueError(f"results must be compared with others than themselves, got {fresh} twice")
    results = store.results_behind(experiments)
    for owner, label in results:
        if store.exists(path := store.path_of(owner, label, root)):
            store.check_note(path, store.read(path)[1], owner, label)
    first = {e.name: e if runs is None else first_runs(e, runs) for e in experiments}
    complete(list(first.values()), fresh, executor)
    for owner, label in results:
        new = first.get(owner.name, owner)
        arrays, note = store.stored(new, label, fresh)
        verdict = Verdict(True, "nothing stored to compare with")
        if store.exists(store.path_of(owner, label, root)):
            old = store.stored(owner, label, root)
            verdict = compare(owner, *old, arrays, range(count_of(new)), note["machine"])
        yield owner, label, verdict


def first_runs(experiment: Experiment, runs: int) -> Experiment:
    """The experiment with its first runs alone, and with all runs of the tasks that these have."""
    whole = ceil(runs / experiment.runs_per_task) * experiment.runs_per_task
    return evolve(experiment, runs=min(whole, experiment.runs))
