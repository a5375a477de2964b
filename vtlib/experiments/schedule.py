"""Computing what experiments lack: units in processes of this machine, or on a Dask cluster.

Runs start as soon as the pool that they transfer from is solved. Killed at any moment, the same
call goes on with the units that are missing.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from multiprocessing.queues import Queue
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from vtlib import __version__, store
from vtlib.experiments.experiment import Experiment
from vtlib.experiments.work import (
    PARTS,
    Unit,
    check,
    compute,
    done,
    join_finished,
    keep,
    pool_weights,
    run_units,
    source_units,
)
from vtlib.sources import Pool

GUESS = 1e-3  # seconds per iteration of one run, where none is stored


class Progress:
    """One bar over units, each as long as it took when the stored results were computed."""

    def __init__(self, units: Sequence[Unit], name: str, quiet: bool) -> None:
        self._seconds = {str(u.part): expected_seconds(u) for u in units}
        self._shares = dict.fromkeys(self._seconds, 0.0)
        self._left = len(units)
        # no smoothing: the time left follows from the average speed of all that was done
        self._bar = tqdm(
            total=sum(self._seconds.values()),
            desc=name,
            disable=quiet or not units,
            smoothing=0,
            bar_format="{desc} {percentage:3.0f}%|{bar}| {elapsed} gone, {remaining} left{postfix}",
        )

    def tell(self, part: str, share: float) -> None:
        """Take note that so much of a unit is done; all of it when the share is 1."""
        if share <= self._shares[part]:
            return  # a late message of a process whose unit is already kept
        self._shares[part] = share
        done = sum(self._shares[p] * self._seconds[p] for p in self._seconds)
        self._bar.update(min(done, self._bar.total) - self._bar.n)
        if share == 1:
            self._left -= 1
            self._bar.set_postfix_str(f" {self._left} units to go", refresh=False)

    def close(self) -> None:
        """End the bar."""
        self._bar.close()


Finished = tuple[store.Arrays, store.Note]
Message = tuple[str, float] | None
Workers = Callable[[Progress], AbstractContextManager[Executor]]


def complete(
    experiments: Sequence[Experiment],
    root: Path,
    workers: Workers,
    quiet: bool = False,
    device: str = "cpu",
) -> None:
    """Compute whatever the experiments, and the pools that they need, still lack under root.

    The posteriors of runs live on the device. Raises, before any work, ValueError where root
    cannot be a folder, store.TornResult where something stored there is not theirs.
    """
    try:
        root.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"results must lie in a folder, got {root}: {error.strerror}") from None
    pools = list({e.pool.name: e.pool for e in experiments}.values())
    units = [u for pool in pools for u in source_units(pool)]
    units += [u for experiment in experiments for u in run_units(experiment)]
    check(units, root)
    join_finished(units, root)
    missing = [u for u in units if not done(u, root)]
    name = experiments[0].name if len(experiments) == 1 else f"{len(experiments)} experiments"
    progress = Progress(missing, name, quiet)
    try:
        if missing:
            with workers(progress) as executor:
                _compute_all(missing, units, root, executor, progress, device)
    finally:
        progress.close()
    _drop_empty(root / PARTS)


def _compute_all(
    missing: Sequence[Unit],
    units: Sequence[Unit],
    root: Path,
    executor: Executor,
    progress: Progress,
    device: str,
) -> None:
    waiting, running = list(missing), dict[Future[Finished], Unit]()
    weights: dict[str, np.ndarray] = {}
    while waiting or running:
        blocked = []
        for unit in waiting:
            pool = _pool_of(unit)
            if pool and not store.exists(root / pool.name / "sources"):
                blocked.append(unit)
                continue
            if pool and pool.name not in weights:
                weights[pool.name] = pool_weights(pool, root)
            given = weights[pool.name] if pool else None
            running[executor.submit(_in_worker, unit, given, device)] = unit
        waiting = blocked
        finished, _ = wait(running, return_when=FIRST_COMPLETED)
        # what is done is kept before an error of another unit ends the work
        for future in sorted(finished, key=lambda f: f.exception() is not None):
            unit = running.pop(future)
            keep(unit, *future.result(), root)
            join_finished([u for u in units if u.result == unit.result], root)
            progress.tell(str(unit.part), 1)


def _pool_of(unit: Unit) -> Pool | None:
    """The pool whose sources the unit needs, if it does."""
    if isinstance(unit.owner, Experiment) and unit.label != "tasks":
        return unit.owner.pool
    return None


def expected_seconds(unit: Unit) -> float:
    """What the unit took of a processor for the book's stored results; a guess where none are."""
    path = store.results_folder() / unit.result
    if store.exists(path):
        note = store.provenance(path)
        of = note["config"]["count" if unit.label == "sources" else "runs"]
        return float(note["seconds"] * len(unit.members) / of)
    return GUESS * len(unit.members) * unit.owner.iterations


def processes(jobs: int) -> Workers:
    """So many processes of this machine, one torch thread each."""
    return partial(_processes, jobs)


@contextmanager
def _processes(jobs: int, progress: Progress) -> Iterator[Executor]:
    context = multiprocessing.get_context("spawn")
    queue = context.Queue()
    watcher = threading.Thread(target=_watch, args=(queue, progress), daemon=True)
    watcher.start()
    try:
        with ProcessPoolExecutor(jobs, context, _begin_worker, (queue,)) as executor:
            try:
                yield executor
            except BaseException:
                executor.shutdown(wait=False, cancel_futures=True)
                raise
    finally:
        queue.put(None)
        watcher.join()


_queue: Queue[Message] | None = None  # where a process of this machine tells how far it is


def _begin_worker(queue: Queue[Message]) -> None:
    global _queue
    _queue = queue
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A worker whose parent was killed would otherwise compute on, or wait for ever."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _in_worker(unit: Unit, weights: np.ndarray | None, device: str) -> Finished:
    torch.set_num_threads(1)

    def report(share: float) -> None:
        if _queue is not None:
            _queue.put((str(unit.part), share))

    return compute(unit, weights, report, device)


def _watch(queue: Queue[Message], progress: Progress) -> None:
    for part, share in iter(queue.get, None):
        progress.tell(part, share)


def cluster(address: str) -> Workers:
    """The workers of a Dask scheduler, such as "tcp://host:8786"; a lost worker's units move on.

    Source: Rocklin (2015), https://distributed.dask.org.
    """
    return partial(_cluster, address)


@contextmanager
def _cluster(address: str, progress: Progress) -> Iterator[Executor]:
    try:
        from distributed import Client
    except ImportError as error:
        raise ValueError("--scheduler needs Dask: pip install distributed") from error
    with Client(address, timeout=10, set_as_default=False) as client:
        _check_versions(client.run(_versions))
        yield client.get_executor(pure=False)


def _versions() -> dict[str, str]:
    """Versions that decide about the numbers; workers of others would leave mixed results."""
    return {"vtlib": __version__, **{k: store.machine()[k] for k in ("torch", "numpy")}}


def _check_versions(workers: dict[str, dict[str, str]]) -> None:
    for worker, theirs in workers.items():
        if theirs != _versions():
            raise ValueError(f"worker {worker} must have {_versions()}, has {theirs}")


def _drop_empty(folder: Path) -> None:
    # a name that begins with a dot is what a kill left half written
    if not any(p.is_file() and not p.name.startswith(".") for p in folder.rglob("*")):
        shutil.rmtree(folder, ignore_errors=True)
