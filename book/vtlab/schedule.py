"""Computing what experiments lack, unit by unit, by the workers of a Dask cluster.

A unit is what can be computed alone: a batch of sources of a pool, an experiment's task table, or a
batch of runs of one algorithm. A finished unit is kept under ``parts`` until its siblings are
there, then they are joined into one stored result. When a worker dies, another one computes its
unit; killed at any moment, the same call goes on with the units that are missing. Source:
Rocklin (2015), https://distributed.dask.org.
"""

import contextlib
import logging
import math
import os
import resource
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import groupby
from pathlib import Path

import dask
import numpy as np
from attrs import frozen
from distributed import Client, Future, LocalCluster, as_completed, get_worker
from tqdm import tqdm

from vtlab import run, sources, store
from vtlab.experiment import SOURCES, TASKS, Experiment, Pool
from vtlab.interrupts import for_this_process_alone, scratch
from vtlib import __version__
from vtlib.training import one_thread

BATCH = 10  # runs that advance together; fixed, so that results never depend on the workers
SOURCE_BATCH = 25  # at most: a small pool is cut in two, for two cores
PARTS = "parts"
ENVIRONMENT = "distributed.nanny.pre-spawn-environ"  # of Dask's processes


@frozen
class Unit:
    """One batch of work towards the stored result of its owner under ``label``."""

    owner: Pool | Experiment
    label: str  # "sources", "tasks" or an algorithm's label
    members: Sequence[int]

    @property
    def part(self) -> Path:
        """Where the finished unit waits for its siblings, relative to the results."""
        span = f"{self.members[0]:03d}-{self.members[-1]:03d}"
        return Path(PARTS) / self.owner.name / f"{self.label}-{span}"

    @property
    def result(self) -> Path:
        """The stored result that the unit belongs to, relative to the results."""
        return Path(self.owner.name) / self.label

    @property
    def pool(self) -> Pool | None:
        """The pool that has to be solved before, if there is one."""
        return None if isinstance(self.owner, Pool) or self.label == TASKS else self.owner.pool

    @property
    def expected_seconds(self) -> float:
        """What it took of a processor for the book's stored results; a guess where none are."""
        of = "count" if isinstance(self.owner, Pool) else "runs"
        with contextlib.suppress(OSError, ValueError, LookupError, TypeError, ArithmeticError):
            note = store.provenance(store.results_folder() / self.result)
            return float(note["seconds"] / note["config"][of] * len(self.members))
        return 1e-3 * len(self.members) * self.owner.iterations


def units_of(owner: Pool | Experiment) -> list[Unit]:
    """The units of a pool or experiment, longest first as it lists its algorithms."""
    if isinstance(owner, Pool):
        labels, count, size = [SOURCES], owner.count, min(SOURCE_BATCH, math.ceil(owner.count / 2))
    else:
        labels, count, size = list(owner.algorithms), owner.runs, BATCH
    parts = [range(at, min(at + size, count)) for at in range(0, count, size)]
    whole = [] if isinstance(owner, Pool) else [Unit(owner, TASKS, range(count))]
    return [Unit(owner, label, part) for label in labels for part in parts] + whole


@one_thread()
def compute(
    unit: Unit,
    weights: np.ndarray | None = None,
    report: Callable[[float], None] = lambda share: None,
    device: str = "cpu",
) -> tuple[store.Arrays, store.Note]:
    """The arrays of one unit, and what it took: seconds of processor, megabytes of memory, machine.

    weights: (count, d), of the pool that runs transfer from. report is told the share done.
    Posteriors live on the device, all else on the processor.
    """
    with contextlib.suppress(OSError):
        # the peak of memory counts from here; where the system cannot, it counts earlier units
        Path("/proc/self/clear_refs").write_text("5")
    began, owner, where = time.process_time(), unit.owner, "cpu"
    if isinstance(owner, Pool):
        most = owner.limit * owner.attempts
        arrays = sources.solve(owner, unit.members, lambda t: report(t / most))
    elif unit.label == TASKS:
        arrays = run.task_table(owner)
    else:
        assert weights is not None
        where = device if owner.algorithms[unit.label].transfers else where

        def progress(t: int) -> bool:
            report(t / owner.iterations)
            return True

        arrays = run.run_batch(owner, unit.label, unit.members, weights, progress, where)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return arrays, {
        "seconds": round(time.process_time() - began, 2),
        "megabytes": round(peak / (1 << 20 if sys.platform == "darwin" else 1 << 10)),
        "machine": store.machine(where),
    }


def keep(unit: Unit, arrays: store.Arrays, note: store.Note, root: Path) -> None:
    """Store a finished unit among the parts."""
    store.save(root / unit.part, arrays, store.origin(unit.owner, unit.label) | note)


def done(unit: Unit, root: Path) -> bool:
    """Whether the unit, or the result that it belongs to, is stored."""
    return store.exists(root / unit.result) or store.exists(root / unit.part)


def check(units: Iterable[Unit], root: Path) -> None:
    """Raise TornResult where what is stored of the units is not theirs, or damaged."""
    places = {path: unit for unit in units for path in (root / unit.result, root / unit.part)}
    for path, unit in places.items():
        if store.exists(path):
            store.check_note(path, store.read(path)[1], unit.owner, unit.label)


def join_finished(units: Iterable[Unit], root: Path) -> None:
    """Join the parts of every result whose units are all finished into one stored result."""
    for result, siblings in groupby(units, lambda unit: unit.result):
        group = list(siblings)
        if not store.exists(root / result):
            if not all(store.exists(root / unit.part) for unit in group):
                continue
            check(group, root)
            parts, notes = zip(*(store.read(root / unit.part) for unit in group), strict=True)
            store.save(root / result, joined(parts), _joined_notes(group[0], notes))
        for unit in group:
            store.remove(root / unit.part)


def joined(parts: Sequence[store.Arrays]) -> store.Arrays:
    """Arrays of all members, from those of some at a time."""
    shared = shared_by_all(parts[0])
    return {
        key: one if key in shared else np.concatenate([part[key] for part in parts])
        for key, one in parts[0].items()
    }


def shared_by_all(arrays: store.Arrays) -> set[str]:
    """The arrays that are the same for all members: of runs, the iterations that were recorded."""
    return {"iterations"} if "learning" in arrays else set()


def _joined_notes(unit: Unit, notes: Sequence[store.Note]) -> store.Note:
    return {
        **store.origin(unit.owner, unit.label),
        "seconds": round(sum(note["seconds"] for note in notes), 2),
        "megabytes": max(note["megabytes"] for note in notes),
        "vtlib": __version__,
        "machine": notes[0]["machine"],
    }


class Progress:
    """One bar over units, each as long as it took when the stored results were computed."""

    def __init__(self, units: Sequence[Unit], name: str, quiet: bool) -> None:
        self._seconds = {str(u.part): u.expected_seconds for u in units}
        self._gone = dict.fromkeys(self._seconds, 0.0)
        self.bar = tqdm(
            total=sum(self._seconds.values()),
            desc=name,
            disable=quiet,
            smoothing=0,  # the time left follows from the average speed of all that was done
            bar_format="{desc} {percentage:3.0f}%|{bar}| {elapsed} gone, {remaining} left",
        )

    def tell(self, part: str, share: float) -> None:
        """Take note that so much of a unit is done, unless more was known to be."""
        self._gone[part] = max(self._gone[part], share * self._seconds[part])
        self.bar.update(min(sum(self._gone.values()), self.bar.total) - self.bar.n)


def complete(
    experiments: Sequence[Experiment],
    root: Path | None = None,
    jobs: int | None = None,
    scheduler: str | None = None,
    device: str = "cpu",
    quiet: bool = False,
) -> None:
    """Compute whatever the experiments, and the pools that they need, still lack under root.

    By as many processes of this machine as there are cores, or ``jobs``, or by the workers of a
    Dask scheduler, such as "tcp://host:8786". A script that calls this needs the guard
    ``if __name__ == "__main__"``, for each process begins by importing it. Posteriors live on the
    device. Raises, before any work, OSError where root cannot be written to, TornResult where
    something stored there is not theirs.
    """
    root = root or store.results_folder()
    store.check_writable(root)
    pools = {e.pool.name: e.pool for e in experiments}.values()
    owners: list[Pool | Experiment] = [*pools, *experiments]
    units = [unit for owner in owners for unit in units_of(owner)]
    if len({u.part for u in units}) < len(units):
        raise ValueError("experiments and pools must have names of their own")
    check(units, root)
    join_finished(units, root)
    missing = [u for u in units if not done(u, root)]
    if missing:
        one = len(experiments) == 1
        name = experiments[0].name if one else f"{len(experiments)} experiments"
        progress = Progress(missing, name, quiet)
        with progress.bar, _cluster(jobs, scheduler, progress) as client:
            _compute_all(missing, root, client, progress, device)
    # a name that begins with a dot is what a kill left half written
    if not any(p.is_file() and not p.name.startswith(".") for p in (root / PARTS).rglob("*")):
        shutil.rmtree(root / PARTS, ignore_errors=True)


def _compute_all(
    missing: list[Unit], root: Path, client: Client, progress: Progress, device: str
) -> None:
    """Hand out units as soon as their pools are solved, and keep what comes back."""
    waiting = list(enumerate(missing))
    running: dict[Future[tuple[store.Arrays, store.Note]], Unit] = {}
    futures = as_completed(loop=client.loop)
    while waiting or running:
        blocked = []
        for place, unit in waiting:
            if unit.pool and not store.exists(store.path_of(unit.pool, SOURCES, root)):
                blocked.append((place, unit))
                continue
            weights = unit.pool and store.weights(unit.pool, root)
            given = unit, weights, _progress_of(client), device
            future = client.submit(_in_worker, *given, pure=False, priority=-place)
            running[future] = unit
            futures.add(future)
        waiting = blocked
        # what is done is kept before an error of another unit ends the work
        for future in sorted(futures.next_batch(), key=lambda f: f.status == "error"):
            unit = running.pop(future)
            arrays, note = future.result()
            keep(unit, arrays, note, root)
            join_finished([u for u in units_of(unit.owner) if u.result == unit.result], root)
            progress.tell(str(unit.part), 1)


def _in_worker(
    unit: Unit, weights: np.ndarray | None, topic: str, device: str
) -> tuple[store.Arrays, store.Note]:
    tell = get_worker().log_event
    return compute(unit, weights, lambda share: tell(topic, (str(unit.part), share)), device)


@contextlib.contextmanager
def _cluster(jobs: int | None, scheduler: str | None, progress: Progress) -> Iterator[Client]:
    """A client of the scheduler, or else of processes of this machine, which end with it."""
    with contextlib.ExitStack() as stack:
        if scheduler is not None:
            client = stack.enter_context(Client(scheduler, timeout=10, set_as_default=False))
        else:
            # Dask has the C library give back memory at once: up to a quarter of the time
            ours = {k: v for k, v in dask.config.get(ENVIRONMENT).items() if "MALLOC" not in k}
            with for_this_process_alone(), dask.config.set({ENVIRONMENT: ours}):
                local = LocalCluster(
                    n_workers=jobs or os.cpu_count() or 1,
                    threads_per_worker=1,
                    dashboard_address="127.0.0.1:0",  # there is a server even without a dashboard
                    scheduler_kwargs={"dashboard": False},
                    local_directory=stack.enter_context(scratch()),
                    memory_limit=0,  # Dask would stop workers at their share of the memory
                    silence_logs=logging.CRITICAL,
                )
            client = stack.enter_context(Client(stack.enter_context(local), set_as_default=False))
        for worker, versions in client.run(_versions).items():
            if versions != _versions():
                raise ValueError(f"worker {worker} must have {_versions()}, has {versions}")
        topic = _progress_of(client)
        client.subscribe_topic(topic, lambda event: progress.tell(*event[1]))
        stack.callback(client.unsubscribe_topic, topic)
        yield client


def _progress_of(client: Client) -> str:
    return f"{client.id} progress"  # under its bare name the scheduler tells of other things


def _versions() -> dict[str, str]:
    """Versions that decide about the numbers; workers of others would leave mixed results."""
    return {"vtlib": __version__, **{k: store.machine()[k] for k in ("torch", "numpy")}}
