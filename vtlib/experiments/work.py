"""Units of work: what can be computed alone, stored when done, and never computed twice.

A unit is a batch of sources of a pool, an experiment's task table, or a batch of runs of one
algorithm. Units run in processes of their own, one torch thread each; a finished unit is kept
under ``parts`` until its siblings are there, then they are joined into one stored result. Killed
at any moment, the same call goes on with the units that are missing.
"""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import shutil
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from vtlib import __version__, store
from vtlib.experiments import POOLS, named
from vtlib.experiments import runs as runs_of
from vtlib.experiments.experiment import Experiment
from vtlib.sources import Pool, solve

BATCH = 10  # runs that advance together; fixed, so that results never depend on the processes
SOURCE_BATCH = 25  # at most: a small pool is cut in two, for two cores
PARTS = "parts"


@dataclass(frozen=True)
class Unit:
    """One batch of work towards the stored result ``owner/label``."""

    owner: str  # a pool's or an experiment's name
    label: str  # "sources", "tasks" or an algorithm's label
    members: tuple[int, ...]

    @property
    def part(self) -> Path:
        """Where the finished unit waits for its siblings, relative to the results."""
        span = f"{self.members[0]:03d}-{self.members[-1]:03d}"
        return Path(PARTS) / self.owner / f"{self.label}-{span}"

    @property
    def result(self) -> Path:
        """The stored result that the unit belongs to, relative to the results."""
        return Path(self.owner) / self.label


def source_units(pool: Pool) -> list[Unit]:
    """The units that solve a pool."""
    size = min(SOURCE_BATCH, math.ceil(pool.count / 2))
    return [Unit(pool.name, "sources", part) for part in _chunks(pool.count, size)]


def run_units(experiment: Experiment) -> list[Unit]:
    """The units of an experiment, longest first as its configuration lists the algorithms."""
    tasks = Unit(experiment.name, "tasks", tuple(range(experiment.runs)))
    batches = _chunks(experiment.runs, BATCH)
    return [
        *(
            Unit(experiment.name, label, part)
            for label in experiment.algorithms
            for part in batches
        ),
        tasks,
    ]


def _chunks(count: int, size: int) -> list[tuple[int, ...]]:
    return [tuple(range(at, min(at + size, count))) for at in range(0, count, size)]


def compute(unit: Unit, root: Path, report: Callable[[Unit, float], bool]) -> store.Arrays:
    """The arrays of one unit; report is told its share done and may stop it by False."""
    if unit.owner in POOLS:
        pool = POOLS[unit.owner]
        return solve(pool, unit.members, lambda t: report(unit, min(t / pool.limit, 0.99)))
    experiment = named(unit.owner)
    if unit.label == "tasks":
        return runs_of.task_table(experiment)
    weights = pool_weights(experiment.pool, root)
    return runs_of.run_batch(
        experiment,
        unit.label,
        unit.members,
        weights,
        lambda t: report(unit, t / experiment.iterations),
    )


def pool_weights(pool: Pool, root: Path) -> np.ndarray:
    """The stored source weights (count, d) of a pool; ValueError when they are not finite."""
    arrays, _ = load_result(pool.name, "sources", root)
    weights = arrays["weights"]
    if len(weights) != pool.count or not np.isfinite(weights).all():
        raise ValueError(f"{pool.name} must hold {pool.count} finite sources")
    return weights


def run_unit(unit: Unit, root: Path, report: Callable[[Unit, float], bool]) -> None:
    """Compute one unit and store it among the parts."""
    began = time.process_time()
    arrays = compute(unit, root, report)
    note = {
        "seconds": round(time.process_time() - began, 2),
        "config": config_of(unit.owner, unit.label),
    }
    store.save(root / unit.part, arrays, note)


def complete(name: str, root: Path, jobs: int, quiet: bool = False) -> None:
    """Compute whatever the named experiment, and the pool it needs, still lack under root."""
    experiment = named(name)
    stages = source_units(experiment.pool), run_units(experiment)
    for owner, label in dict.fromkeys((u.owner, u.label) for units in stages for u in units):
        if store.exists(root / owner / label):
            load_result(owner, label, root)
    for unit in (u for units in stages for u in units if store.exists(root / u.part)):
        _, note = store.load(root / unit.part)
        _check_config(root / unit.part, note, config_of(unit.owner, unit.label))
    for units in stages:
        join_finished(units, root)
        missing = [u for u in units if not _done(u, root)]
        if missing:
            _run_all(missing, units, root, jobs, quiet)
            join_finished(units, root)
    _drop_empty(root / PARTS)


def _done(unit: Unit, root: Path) -> bool:
    return store.exists(root / unit.result) or store.exists(root / unit.part)


def _run_all(
    missing: Sequence[Unit], units: Sequence[Unit], root: Path, jobs: int, quiet: bool
) -> None:
    """Run missing units in ``jobs`` processes, with one progress bar; join results of ``units``."""
    context = multiprocessing.get_context("spawn")
    queue = context.Queue()
    with tqdm(total=100 * len(missing), desc=units[0].owner, unit="%", disable=quiet) as bar:
        watcher = threading.Thread(target=_watch, args=(queue, bar), daemon=True)
        watcher.start()
        try:
            _compute_all(missing, units, root, jobs, context, queue)
        finally:
            queue.put(None)
            watcher.join()


def _compute_all(
    missing: Sequence[Unit], units: Sequence[Unit], root: Path, jobs: int, context, queue
) -> None:
    with ProcessPoolExecutor(jobs, context, _begin_worker, (queue,)) as executor:
        futures = [executor.submit(_in_process, unit, root) for unit in missing]
        try:
            for future in as_completed(futures):
                future.result()
                # of all units: a result's other parts may be left from a run that was stopped
                join_finished(units, root)
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            raise


_queue = None  # where a worker reports to


def _begin_worker(queue) -> None:
    global _queue
    _queue = queue
    torch.set_num_threads(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A worker whose parent was killed would otherwise compute on, or wait for ever."""
    multiprocessing.parent_process().join()
    os._exit(1)


def _in_process(unit: Unit, root: Path) -> None:
    def report(unit: Unit, share: float) -> bool:
        _queue.put((unit, share))
        return True

    run_unit(unit, root, report)
    _queue.put((unit, 1.0))


def _watch(queue, bar: tqdm) -> None:
    shares: dict[Unit, float] = {}
    for unit, share in iter(queue.get, None):
        bar.update(round(100 * share) - round(100 * shares.get(unit, 0.0)))
        shares[unit] = share


def join_finished(units: Iterable[Unit], root: Path) -> None:
    """Join the parts of every result whose units are all finished into one stored result."""
    siblings: dict[Path, list[Unit]] = {}
    for unit in units:
        siblings.setdefault(unit.result, []).append(unit)
    for result, group in siblings.items():
        if store.exists(root / result) or not all(store.exists(root / u.part) for u in group):
            continue
        parts = [store.load(root / u.part) for u in group]
        for unit, (_, note) in zip(group, parts, strict=True):
            _check_config(root / unit.part, note, config_of(unit.owner, unit.label))
        store.save(root / result, _join([arrays for arrays, _ in parts]), _provenance(group, parts))
        for unit in group:
            store.remove(root / unit.part)


def _join(parts: Sequence[store.Arrays]) -> store.Arrays:
    """Concatenate along runs; the recorded iterations are the same in every part."""
    shared = {"iterations"} if "learning" in parts[0] else set()
    return {
        key: parts[0][key] if key in shared else np.concatenate([p[key] for p in parts])
        for key in parts[0]
    }


def _provenance(group: Sequence[Unit], parts: Sequence[tuple]) -> dict:
    owner, label = group[0].owner, group[0].label
    stream = POOLS[owner].stream if owner in POOLS else named(owner).stream
    return {
        "owner": owner,
        "label": label,
        "config": config_of(owner, label),
        "seeds": f"SHA-256 of {stream}/<run>/<role>",
        "seconds": round(sum(note["seconds"] for _, note in parts), 2),
        "vtlib": __version__,
        "machine": store.machine(),
    }


def config_of(owner: str, label: str) -> dict:
    """The configuration behind a stored result, as plain JSON values."""
    if owner in POOLS:
        return _plain(asdict(POOLS[owner]))
    experiment = named(owner)
    config = {
        "runs": experiment.runs,
        "sources": experiment.sources,
        "pool": experiment.pool.name,
        "family": asdict(experiment.family),
        "stream": experiment.stream,
    }
    if experiment.probes:
        config["probes"] = experiment.probes
    if experiment.excluded:
        config["excluded"] = experiment.excluded
    if experiment.runs_per_task > 1:
        config["runs_per_task"] = experiment.runs_per_task
    if label in experiment.algorithms:
        config["sources"] = experiment.sources_of(label)
        config["iterations"] = experiment.iterations
        config["every"] = experiment.every
        config["algorithm"] = asdict(experiment.algorithms[label])
        if config["algorithm"].get("covariance") == "full":
            # as it was before there was a choice, so that what was stored then stays valid
            del config["algorithm"]["covariance"]
    return _plain(config)


def _plain(config: dict) -> dict:
    return json.loads(json.dumps(config))


def load_result(owner: str, label: str, root: Path) -> tuple[store.Arrays, dict]:
    """A stored result and its provenance.

    Raises FileNotFoundError when it is missing, store.TornResult when it is damaged or was
    computed under another configuration.
    """
    arrays, note = store.load(root / owner / label)
    _check_config(root / owner / label, note, config_of(owner, label))
    return arrays, note


def _check_config(path: Path, note: dict, config: dict) -> None:
    stored = note.get("config")
    if stored != config:
        raise store.TornResult(
            f"{path} was computed under another configuration: move it away and run "
            f"`python -m vtlib run` again (stored {stored}, now {config})"
        )


def _drop_empty(folder: Path) -> None:
    # a name that begins with a dot is what a kill left half written
    if not any(p.is_file() and not p.name.startswith(".") for p in folder.rglob("*")):
        shutil.rmtree(folder, ignore_errors=True)
