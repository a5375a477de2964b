"""Computing what experiments lack, unit by unit, by an executor of ``concurrent.futures``.

A finished unit is kept under ``parts`` until its siblings are there, then they are joined into one
stored result. Killed at any moment, the same call goes on with the units that are missing.
"""

import contextlib
import shutil
from collections.abc import Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from itertools import groupby
from pathlib import Path

from tqdm import tqdm

from vtlab import store
from vtlab.experiment import SOURCES, Experiment, Pool
from vtlab.units import Unit, compute, joined, units_of
from vtlab.workers import processes


def keep(unit: Unit, arrays: store.Arrays, note: store.Note, root: Path) -> None:
    """Store a finished unit among the parts, and its result if it was the last of it."""
    store.save(root / unit.part, arrays, store.origin(unit.owner, unit.label) | note)
    join_finished((u for u in units_of(unit.owner) if u.result == unit.result), root)


def join_finished(units: Iterable[Unit], root: Path) -> None:
    """Join the parts of every result whose units are all finished into one stored result."""
    for result, siblings in groupby(units, lambda unit: unit.result):
        group = list(siblings)
        if not store.exists(root / result):
            if not all(store.exists(root / unit.part) for unit in group):
                continue
            parts, notes = zip(*(store.read(root / unit.part) for unit in group), strict=True)
            seconds = round(sum(note["seconds"] for note in notes), 2)
            store.save(root / result, joined(parts), notes[0] | {"seconds": seconds})
        for unit in group:
            store.remove(root / unit.part)


def complete(
    experiments: Sequence[Experiment], root: Path, executor: Executor | None = None
) -> None:
    """Compute whatever the experiments, and the pools that they need, still lack under root.

    Without an executor a process for each core computes: then a script needs the guard
    ``if __name__ == "__main__"``, because each process begins by importing it. Raises, before any
    work, OSError where root cannot be written to, TornResult where something stored there is not
    theirs.
    """
    store.check_writable(root)
    pools = {e.pool.name: e.pool for e in experiments}.values()
    owners: list[Pool | Experiment] = [*pools, *experiments]
    units = [unit for owner in owners for unit in units_of(owner)]
    if len({u.part for u in units}) < len(units):
        raise ValueError("experiments and pools must have names of their own")
    places = {path: unit for unit in units for path in (root / unit.result, root / unit.part)}
    for path, unit in places.items():
        if store.exists(path):
            store.check_note(path, store.read(path)[1], unit.owner, unit.label)
    join_finished(units, root)
    missing = [u for u in units if not any(store.exists(root / x) for x in (u.result, u.part))]
    if missing:
        with contextlib.nullcontext(executor) if executor else processes() as workers:
            _compute_all(missing, root, workers)
    # a file whose name begins with a dot was left half written by a kill
    if not any(p.is_file() and not p.name.startswith(".") for p in (root / "parts").rglob("*")):
        shutil.rmtree(root / "parts", ignore_errors=True)


def _compute_all(missing: Sequence[Unit], root: Path, executor: Executor) -> None:
    """Hand out units as soon as their pools are solved, and keep what comes back."""
    seconds = {unit.part: unit.expected_seconds for unit in missing}
    form = "{percentage:3.0f}%|{bar}| {elapsed} gone, {remaining} left"
    # the time left follows from the average speed of all that was done
    bar = tqdm(total=sum(seconds.values()), smoothing=0, bar_format=form)
    waiting, running = list(missing), dict[Future[tuple[store.Arrays, store.Note]], Unit]()
    with bar:
        while waiting or running:
            blocked = []
            for unit in waiting:
                if unit.pool and not store.exists(store.path_of(unit.pool, SOURCES, root)):
                    blocked.append(unit)
                    continue
                weights = store.weights(unit.pool, root) if unit.pool else None
                running[executor.submit(compute, unit, weights)] = unit
            waiting = blocked
            ended = wait(running, return_when=FIRST_COMPLETED).done
            # finished units are kept before an error of another one ends the work
            for future in sorted(ended, key=lambda x: x.exception() is not None):
                unit = running.pop(future)
                arrays, note = future.result()
                keep(unit, arrays, note, root)
                bar.update(min(seconds[unit.part], bar.total - bar.n))  # sums are rounded
