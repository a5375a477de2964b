"""Units of work: what can be computed alone, stored when done, and never computed twice.

A unit is a batch of sources of a pool, an experiment's task table, or a batch of runs of one
algorithm. It carries what it needs, so that any process, here or elsewhere, can compute it. A
finished unit is kept under ``parts`` until its siblings are there, then they are joined into one
stored result.
"""

from __future__ import annotations

import contextlib
import json
import math
import resource
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from vtlib import __version__, store
from vtlib.experiments import POOLS, named
from vtlib.experiments import runs as runs_of
from vtlib.experiments.experiment import Experiment
from vtlib.sources import Pool, check_pool_weights, solve
from vtlib.transfer import Settings

BATCH = 10  # runs that advance together; fixed, so that results never depend on the processes
SOURCE_BATCH = 25  # at most: a small pool is cut in two, for two cores
PARTS = "parts"


@dataclass(frozen=True)
class Unit:
    """One batch of work towards the stored result of its owner under ``label``."""

    owner: Pool | Experiment
    label: str  # "sources", "tasks" or an algorithm's label
    members: tuple[int, ...]

    @property
    def part(self) -> Path:
        """Where the finished unit waits for its siblings, relative to the results."""
        span = f"{self.members[0]:03d}-{self.members[-1]:03d}"
        return Path(PARTS) / self.owner.name / f"{self.label}-{span}"

    @property
    def result(self) -> Path:
        """The stored result that the unit belongs to, relative to the results."""
        return Path(self.owner.name) / self.label


def source_units(pool: Pool) -> list[Unit]:
    """The units that solve a pool."""
    size = min(SOURCE_BATCH, math.ceil(pool.count / 2))
    return [Unit(pool, "sources", part) for part in _chunks(pool.count, size)]


def run_units(experiment: Experiment) -> list[Unit]:
    """The units of an experiment, longest first as its configuration lists the algorithms."""
    tasks = Unit(experiment, "tasks", tuple(range(experiment.runs)))
    batches = _chunks(experiment.runs, BATCH)
    return [
        *(Unit(experiment, label, part) for label in experiment.algorithms for part in batches),
        tasks,
    ]


def results_of(experiment: Experiment) -> list[tuple[Pool | Experiment, str]]:
    """The stored results behind an experiment, as owner and label."""
    return [
        (experiment.pool, "sources"),
        (experiment, "tasks"),
        *((experiment, label) for label in experiment.algorithms),
    ]


def _chunks(count: int, size: int) -> list[tuple[int, ...]]:
    return [tuple(range(at, min(at + size, count))) for at in range(0, count, size)]


def compute(
    unit: Unit,
    weights: np.ndarray | None,
    report: Callable[[float], None] = lambda share: None,
    device: str = "cpu",
) -> tuple[store.Arrays, store.Note]:
    """The arrays of one unit, and what it took: seconds of processor, megabytes of memory, machine.

    weights (count, d) are those of the pool that runs transfer from; report is told the share done;
    posteriors live on the device, all else on the processor.
    """
    if not _transfers(unit):
        device = "cpu"
    _forget_peak()
    began = time.process_time()
    arrays = _compute(unit, weights, report, device)
    seconds = round(time.process_time() - began, 2)
    return arrays, {"seconds": seconds, "megabytes": _peak(), "machine": store.machine(device)}


def _transfers(unit: Unit) -> bool:
    owner = unit.owner
    return isinstance(owner, Experiment) and isinstance(owner.algorithms.get(unit.label), Settings)


def _compute(
    unit: Unit, weights: np.ndarray | None, report: Callable[[float], None], device: str
) -> store.Arrays:
    owner = unit.owner
    if isinstance(owner, Pool):
        longest = owner.limit * owner.attempts
        return solve(owner, unit.members, lambda t: report(min(t / longest, 0.99)))
    if unit.label == "tasks":
        return runs_of.task_table(owner)

    def progress(t: int) -> bool:
        report(t / owner.iterations)
        return True

    assert weights is not None
    return runs_of.run_batch(owner, unit.label, unit.members, weights, progress, device)


def _forget_peak() -> None:
    """Let the peak of memory count from here; where the system cannot, it counts earlier units."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak() -> int:
    """Largest memory of this process, in megabytes."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / (1 << 20 if sys.platform == "darwin" else 1 << 10))


def pool_weights(pool: Pool, root: Path) -> np.ndarray:
    """The stored source weights (count, d) of a pool; ValueError when they are anything else."""
    arrays, _ = load(pool, "sources", root)
    weights = arrays.get("weights", np.zeros(0))
    check_pool_weights(pool, weights)
    return weights


def keep(unit: Unit, arrays: store.Arrays, note: store.Note, root: Path) -> None:
    """Store a finished unit among the parts."""
    store.save(root / unit.part, arrays, {**note, "config": config_of(unit.owner, unit.label)})


def done(unit: Unit, root: Path) -> bool:
    """Whether the unit, or the result that it belongs to, is stored."""
    return store.exists(root / unit.result) or store.exists(root / unit.part)


def check(units: Iterable[Unit], root: Path) -> None:
    """Raise store.TornResult where what is stored of the units is not theirs, or damaged."""
    for result, unit in {u.result: u for u in units}.items():
        if store.exists(root / result):
            load(unit.owner, unit.label, root)
    for unit in units:
        if store.exists(root / unit.part):
            _, note = store.load(root / unit.part)
            _check_config(root / unit.part, note, config_of(unit.owner, unit.label))


def join_finished(units: Iterable[Unit], root: Path) -> None:
    """Join the parts of every result whose units are all finished into one stored result."""
    siblings: dict[Path, list[Unit]] = {}
    for unit in units:
        siblings.setdefault(unit.result, []).append(unit)
    for result, group in siblings.items():
        if not store.exists(root / result):
            if not all(store.exists(root / u.part) for u in group):
                continue
            check(group, root)
            parts = [store.load(root / u.part) for u in group]
            arrays = _join([arrays for arrays, _ in parts])
            store.save(root / result, arrays, _provenance(group, parts))
        for unit in group:
            store.remove(root / unit.part)


def _join(parts: Sequence[store.Arrays]) -> store.Arrays:
    """Concatenate along runs; the recorded iterations are the same in every part."""
    shared = {"iterations"} if "learning" in parts[0] else set()
    return {
        key: parts[0][key] if key in shared else np.concatenate([p[key] for p in parts])
        for key in parts[0]
    }


def _provenance(
    group: Sequence[Unit], parts: Sequence[tuple[store.Arrays, store.Note]]
) -> store.Note:
    owner, label = group[0].owner, group[0].label
    notes = [note for _, note in parts]
    return {
        "owner": owner.name,
        "label": label,
        "config": config_of(owner, label),
        "seeds": f"SHA-256 of {owner.stream}/<run>/<role>",
        "seconds": round(sum(note["seconds"] for note in notes), 2),
        "megabytes": max(note.get("megabytes", 0) for note in notes),
        "vtlib": __version__,
        "machine": notes[0].get("machine", store.machine()),
    }


def config_of(owner: Pool | Experiment, label: str) -> store.Note:
    """The configuration behind a stored result, as plain JSON values."""
    if isinstance(owner, Pool):
        solving = asdict(owner)
        if owner.attempts == 1:
            # as it was before there could be more, so that what was stored then stays valid
            del solving["attempts"]
        return _plain(solving)
    config: store.Note = {
        "runs": owner.runs,
        "sources": owner.sources,
        "pool": owner.pool.name,
        "family": asdict(owner.family),
        "stream": owner.stream,
    }
    if owner.probes:
        config["probes"] = owner.probes
    if owner.excluded:
        config["excluded"] = owner.excluded
    if owner.runs_per_task > 1:
        config["runs_per_task"] = owner.runs_per_task
    if label in owner.algorithms:
        config["sources"] = owner.sources_of(label)
        config["iterations"] = owner.iterations
        config["every"] = owner.every
        config["algorithm"] = asdict(owner.algorithms[label])
        if config["algorithm"].get("covariance") == "full":
            # as it was before there was a choice, so that what was stored then stays valid
            del config["algorithm"]["covariance"]
    return _plain(config)


def _plain(config: store.Note) -> store.Note:
    plain: store.Note = json.loads(json.dumps(config))
    return plain


def load_result(owner: str, label: str, root: Path) -> tuple[store.Arrays, store.Note]:
    """A stored result of the pool or experiment of that name, as ``load`` returns it."""
    return load(POOLS[owner] if owner in POOLS else named(owner), label, root)


def load(owner: Pool | Experiment, label: str, root: Path) -> tuple[store.Arrays, store.Note]:
    """A stored result and its provenance.

    Raises FileNotFoundError when it is missing, store.TornResult when it is damaged or was
    computed under another configuration.
    """
    path = root / owner.name / label
    arrays, note = store.load(path)
    _check_config(path, note, config_of(owner, label))
    return arrays, note


def _check_config(path: Path, note: store.Note, config: store.Note) -> None:
    stored = note.get("config")
    if stored != config:
        raise store.TornResult(
            f"{path} was computed under another configuration: move it away and run "
            f"`python -m vtlib run` again (stored {stored!r}, now {config})"
        )
    if not isinstance(note.get("seconds"), int | float):
        raise store.TornResult(f"{path} has a provenance that does not tell its seconds")
