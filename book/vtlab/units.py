"""Units of work: some sources of a pool, an experiment's task table, some runs of an algorithm."""

import contextlib
import math
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from attrs import frozen

from vtlab import run, sources, store
from vtlab.experiment import SOURCES, TASKS, Experiment, Pool
from vtlib import __version__
from vtlib.training import arithmetic

BATCH = 10  # runs that advance together; fixed, so that results never depend on the workers
SOURCE_BATCH = 25  # at most; a smaller pool is cut in two, so that two cores can share it


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
        return Path("parts") / self.owner.name / f"{self.label}-{span}"

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
        """Processor time of the same unit in the stored results; a guess where there are none."""
        size = "count" if isinstance(self.owner, Pool) else "runs"
        with contextlib.suppress(OSError, ValueError, LookupError, TypeError, ArithmeticError):
            note = store.provenance(store.results_folder() / self.result)
            return float(note["seconds"] / note["config"][size] * len(self.members))
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


def units_with(owner: Pool | Experiment, label: str, members: Sequence[int]) -> list[Unit]:
    """The units that members of a result come from: by themselves if by kernels, else batches."""
    if isinstance(owner, Experiment) and run.by_kernels(owner, label):
        return [Unit(owner, label, members)]
    units = (unit for unit in units_of(owner) if unit.label == label)
    return [unit for unit in units if not set(members).isdisjoint(unit.members)]


def expected_seconds(owner: Pool | Experiment, label: str, member: int) -> float:
    """Processor time that computing a member of a result anew should take."""
    return sum(unit.expected_seconds for unit in units_with(owner, label, [member]))


@arithmetic()
def compute(unit: Unit, weights: np.ndarray | None = None) -> tuple[store.Arrays, store.Note]:
    """The arrays of one unit, and what it took: seconds of processor, and on which machine.

    Runs transfer from weights (count, d) of their pool.
    """
    began, owner = time.process_time(), unit.owner
    if isinstance(owner, Pool):
        arrays = sources.solve(owner, unit.members)
    elif unit.label == TASKS:
        arrays = run.task_table(owner)
    else:
        assert weights is not None
        arrays = run.run_batch(owner, unit.label, unit.members, weights)
    return arrays, {
        "seconds": round(time.process_time() - began, 2),
        "vtlib": __version__,
        "machine": store.machine(),
    }


def joined(parts: Sequence[store.Arrays]) -> store.Arrays:
    """Arrays of all members, from those of some at a time."""
    shared = shared_by_all(parts[0])
    return {
        key: array if key in shared else np.concatenate([part[key] for part in parts])
        for key, array in parts[0].items()
    }


def shared_by_all(arrays: store.Arrays) -> set[str]:
    """The arrays that are the same for all members: of runs, the iterations that were recorded."""
    return {"iterations"} if "learning" in arrays else set()
